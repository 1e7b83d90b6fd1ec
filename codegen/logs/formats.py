"""Extensions of the formats of logs. The command line imports this module at its start, so it imports nothing."""

TABLE_ENDINGS = (".csv", ".tsv", ".txt", ".dat")
MEASUREMENTS = (*TABLE_ENDINGS, ".parquet", ".mf4")
"""Measurements. An MF4 may be the log of a bus as well."""
LOGS = (".blf", ".asc", ".log", ".mf4")
"""Logs of a bus."""
ENDINGS = tuple(dict.fromkeys((".mf4", *LOGS, *MEASUREMENTS)))
KINDS = "give .mf4, .blf, .asc, .log (candump), .csv or .parquet"
