"""A bare-metal project around a build, and its run in QEMU."""
