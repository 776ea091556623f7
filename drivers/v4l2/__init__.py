"""Video4Linux2 camera driver by ioctl, mmap and poll, which tracks age and loss of
frames.
"""
