"""From map and configuration to C. Layer 4: imports `errors`, `config`, `vehicle` and `refmap`."""
