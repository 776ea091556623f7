"""The fault campaign: devices that fail, and every fault in every state of a fold."""
