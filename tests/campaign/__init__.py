"""What shows that the generated C is tested: parts beyond `codegen verify`, which need the tests or Debian's tools."""
