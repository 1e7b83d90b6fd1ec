"""Design of the controller: gains, lead, trim and fail-safe; margins of the loop; loss of rear steering."""
