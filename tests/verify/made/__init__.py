"""Checks with known outcomes, each a module, as those of `codegen.verify`, so that other processes can import them."""
