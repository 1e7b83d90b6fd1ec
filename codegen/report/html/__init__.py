"""`codegen report`: one HTML file for a map, a build and its runs."""
