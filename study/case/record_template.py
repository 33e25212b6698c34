"""The template of a measured record, with every key that it takes, and an example of its traces."""

import importlib.resources

_TEMPLATE = """\
# What was measured in one patient. "jaxfsi diagnose FOLDER" compares it with the model; this file
# is FOLDER/record.toml. Every key that carries a unit ends in it. Lines that begin with "#name ="
# or "#[" are optional and show the default, or an example where it says so; remove the "#" to set
# them. What a case file knows too is spelt as there. Any table takes source = "..." and
# notes = "...".

[patient]
id = "patient-01"                    # names the results: letters, digits, ". _ -"
#source = "catheter report"
#notes = "free text"

# The artery at its origin. Without R0 the record says 5.0e3 within a factor of 2.7 (95 %);
# jaxfsi diagnose --case takes R0 from a case, or the whole curve from a finished study.
#[surrogate]
#R0_dyn_s_per_cm5 = 5.0e3            # example; 10 to 1e7, or R0_mmHg_s_per_ml = 3.75
# or with the standard deviation of its logarithm, 0.01 to 3, which is 0.15 where it is not given:
# R0_dyn_s_per_cm5 = { value = 5.0e3, sd_log = 0.15 }
#K_dyn_s2_per_cm8 = 1.0e3            # example; 0 to 1e7, or K_mmHg_s2_per_ml2 = 0.75: dP = K Q |Q|
#L_mmHg_s2_per_ml = 0.03             # example; 0 to 100: dP = L dQ/dt

# Noise, as standard deviations. That of the mean beat is estimated from the scatter of the beats
# where three or more were recorded.
#[noise]
#pressure_sd_mmHg = 1.0              # one sample of the mean beat, not of one beat; 0.02 to 20
#pressure_offset_sd_mmHg = 0.5        # zero error of a whole pressure trace; 0.01 to 20
#flow_relative_sd = 0.05             # of a flow, over its mean in the beat; 0.001 to 1
#ffr_sd = 0.01                       # of a pressure ratio; 0.0005 to 0.2

# One table for each condition, under any name, in the order in which they were measured. Each needs
# the aortic pressures and the period, and something to compare with: ffr, means or traces.
[condition.rest]
drug = "none"                        # none | adenosine | dobutamine; by default what the name says
period_s = 0.80                      # 60 / heart rate; 0.2 to 3
P_systolic_mmHg = 110.0              # aortic; 30 to 300
P_diastolic_mmHg = 65.0              # aortic; 20 to 200
ffr = 0.91                           # mean distal over mean aortic pressure; 0 to 1.15
#mean_P_aorta_mmHg = 86.5             # example; 20 to 250
#mean_P_distal_mmHg = 78.5            # example; 5 to 250
#mean_flow_ml_per_min = 130.0        # example: coronary flow; 0 to 2000
#file = "rest.csv"                   # example: traces beside this file, see below
#order = 0                           # place in time, 0 to 20; default: as in this file
#held_out = false                    # true: predicted only, then compared

[condition.dobutamine]
drug = "dobutamine"
period_s = 0.45
P_systolic_mmHg = 130.0
P_diastolic_mmHg = 70.0
ffr = 0.90

# Traces are CSV files. The first line names the columns: time_s, P_aorta_mmHg, and where recorded
# P_distal_mmHg and Q_coronary_ml_per_min, the flow into the artery at its origin. Give one beat
# from the opening of the aortic valve on, the first sample at 0 s; or a recording, which may begin
# and end within a beat: its clock need not divide the beats, beats may differ in length, and rows
# may be lost. "jaxfsi template --record --out FOLDER" writes an example, rest.csv.
"""

RECORD_FILE, EXAMPLE_FILE = "record.toml", "rest.csv"


def record_template() -> str:
    """A commented record to start from; it is itself a valid record."""
    return _TEMPLATE


def example_traces() -> str:
    """One beat at rest as a CSV file: the model's own, with the pressures of the template."""
    folder = importlib.resources.files("study") / "data" / "record_example"
    return (folder / EXAMPLE_FILE).read_text("utf-8")
