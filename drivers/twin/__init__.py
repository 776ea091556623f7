"""The digital twin: simulated arm, hand, camera and strip. No controller may import
it.
"""
