"""The feedback's gains by design: the family of cars, its sampled loops, their margins, the search; loss of rear steering."""
