"""Everything that `codegen tune` determines for the controller of a map."""
