"""The digital twin: what stands in for hardware. No controller may import it."""
