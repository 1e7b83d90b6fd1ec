"""Pictures of maps, tyres and runs, for papers and reports."""
