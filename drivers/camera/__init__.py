"""The real camera: Video4Linux2 by ioctl, mmap and poll, with every frame's age and losses."""
