"""Which commands take which kind of input, and which say what they would do."""

ON_CASES = ("run", "calibrate", "calibrate-wall", "sweep", "mesh", "simulate", "study", "what-if")
ON_RECORDS = ("diagnose", "plan-measurement")
PLANNED = ("run", "simulate", "study", "cohort", "diagnose")
"""Commands with --dry-run."""

WITHOUT_FOLDER = ("check", "doctor", "cache", "completion")
"""Commands that write no file."""
