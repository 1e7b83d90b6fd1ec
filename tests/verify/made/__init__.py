"""Checks with a known end, to run in processes of their own: a module each, as those of `codegen.verify`."""
