"""Software in the loop: the generated C, compiled and called from Python."""
