"""Case files, the pipeline of one patient, reports and the command line."""

from study.demo import demo_case_path as demo_case_path
