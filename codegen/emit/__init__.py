"""From map and configuration to C."""
