"""The map that an ECU stores: extension to a total map, breakpoints, storage, and its reference lookup."""
