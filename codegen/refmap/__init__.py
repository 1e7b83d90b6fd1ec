"""The optimal yaw-rate reference map: solve, store, extend, look up. Layer 3."""
