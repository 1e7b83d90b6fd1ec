"""Export of a build as AUTOSAR Classic: ARXML of the software component and of the system, and the adapter in C."""
