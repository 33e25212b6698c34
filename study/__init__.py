"""Case files, the pipeline of one patient, reports and the command line."""
