"""Checks with known outcomes: modules like those of `codegen.verify`, so that other processes can import them."""
