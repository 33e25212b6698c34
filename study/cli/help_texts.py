"""Help of the command line: what each command does, with examples."""

from study.store.cache_folder import VARIABLE

DESCRIPTION = """\
Predicts pressure ratios (FFR, resting Pd/Pa) of anomalous coronary arteries, with 0D and 3D
fluid-structure models tuned to one patient. Research software, not a medical device.
"""

EPILOG = f"""\
examples:
  jaxfsi template > case.toml             start a case file (--record: a measured record)
  jaxfsi check case.toml                  what is wrong with it, and what can be run
  jaxfsi run --demo                       the real patient that comes with the package
  jaxfsi run case.toml                    results in case-results/, report.html first
  jaxfsi mesh case.toml                   mesh of blood and wall, with pictures
  jaxfsi show case-results                what was found, in the terminal

exit status: 0 done, 1 the computation failed, 2 the input was refused, 130 interrupted.
Compiled code is kept in the user's cache folder; set {VARIABLE} to another folder, or to off.
NO_COLOR=1 leaves colours out; JAXFSI_TRACEBACK=1 shows where a computation failed.
"""

HELP = {
    "run": (
        "calibrate a patient at rest, predict every condition, write a report",
        """\
examples:
  jaxfsi run case.toml
  jaxfsi run --demo --out results
  jaxfsi run case.toml --uncertainty        each FFR with an interval and its causes
  jaxfsi run case.toml --json > summary.json

writes result.json and report.html into the output folder. --mesh adds a coarse mesh of the first
state and shows it in the report; --demo does so too unless --no-mesh is given.
""",
    ),
    "calibrate": (
        "find alpha, the scale of the outlet's resistances, from the resting ratio",
        """\
examples:
  jaxfsi calibrate case.toml
  jaxfsi calibrate case.toml --json

needs [condition.rest] with ffr, and R0, an ivus anatomy or a [body]; writes calibration.json.
""",
    ),
    "calibrate-wall": (
        "find the stiffness of the wall from lumens measured in several states",
        """\
examples:
  jaxfsi calibrate-wall case.toml
  jaxfsi calibrate-wall case.toml --fit rest_systole dobutamine_systole
  jaxfsi calibrate-wall case.toml --free aorta coronary thickness --course 8

needs an ivus anatomy with further states, [anatomy.states.CONDITION_systole], and the pressures of
their conditions. The states that are not fitted are predicted. Writes wall.html and wall.json.
""",
    ),
    "sweep": (
        "ratios and flows over a range of alpha",
        """\
examples:
  jaxfsi sweep case.toml --alpha 0.01:10:200
  jaxfsi sweep case.toml --alpha 0.05:1:50 --condition dobutamine --rule all

alpha runs in equal ratios from FROM to TO; writes sweep.json, sweep.csv and sweep.svg.
""",
    ),
    "mesh": (
        "make a labelled mesh of blood and wall that share their nodes",
        """\
examples:
  jaxfsi mesh case.toml                                     first state, preset of the case
  jaxfsi mesh case.toml --state all --preset medium
  jaxfsi mesh case.toml --elements-across 8 --format vtu,folder
  jaxfsi mesh --demo --out results

writes the mesh in each format, mesh.json with all its numbers, mesh.html and its pictures. A mesh
that was made before comes from the cache. The format folder has an input of svMultiPhysics for rest
beside it, solver.xml, where the case says enough for a run in 3D.
""",
    ),
    "simulate": (
        "run blood and wall in 3D, with the circulation behind every outlet",
        """\
examples:
  jaxfsi simulate case.toml                          rest, as many cycles as the case says
  jaxfsi simulate case.toml --condition dobutamine --preset coarse
  jaxfsi simulate case.toml --rigid --cycles 1
  jaxfsi simulate --demo --preset coarse --cycles 0.05

needs an anatomy and the cardiac output. Writes fields/fields.pvd (open it in ParaView, even while
the run is in progress; Warp By Vector with displacement_cm moves the points), history.csv,
shear.vtu, pressure and lumen along the artery (centerline.vtp, pullback.csv), its lumen in colours
(lumen.glb), simulation.json and simulation.html. Running the same command again resumes an
interrupted run if its input is unchanged (compared by hash); --restart starts over and moves the
files of the earlier run to the sub-folder earlier-1 (then earlier-2, ...). Ctrl-C keeps every
completed block of ten steps.
""",
    ),
    "study": (
        "the full 3D study: resistance ramp, calibration with 3D in the loop, rest and stress",
        """\
examples:
  jaxfsi study case.toml --preset coarse             everything, one cycle each
  jaxfsi study case.toml --cycles 4 --continued      four cycles at rest, then four under stress
  jaxfsi study case.toml --rules printed,all --nominal
  jaxfsi study case.toml --sensitivities dobutamine  and which piece of the lumen moves FFR
  jaxfsi study case.toml --uncertainty 4             each FFR in 3D with an interval and its causes
  jaxfsi study --demo --quick --out results          the bundled patient in three to five minutes

needs an anatomy, the cardiac output and the measured resting ratio. Writes study.html, study.json,
pictures, stages/ and the fields of every run below runs/. Run again, the command resumes where it
stopped and recomputes only what a changed input affects.
""",
    ),
    "what-if": (
        "an operation on the artery: lumen, loss and ratios before and after on one page",
        """\
examples:
  jaxfsi what-if case.toml --unroof                the intramural course opened into the aorta
  jaxfsi what-if case.toml --reimplant             cut off, a round ostium in the proper sinus
  jaxfsi what-if case.toml --stent 3.5             round and 3.5 mm wide
  jaxfsi what-if case.toml --unroof --mode 3d --quick
  jaxfsi what-if case.toml --unroof --mode 3d --from case-results   after a finished study

needs an anatomy of kind ivus or synthetic, and what study needs. The bed stays: alpha is tuned to
the measured resting ratio before the operation and kept. In 0D the loss of the artery is scaled by
the law of its lumen, in 3D the operated anatomy is meshed and run. Writes what-if.html,
what-if.json, before/ and after/.
""",
    ),
    "cohort": (
        "many cases side by side, and how predicted and measured ratios agree",
        """\
examples:
  jaxfsi cohort patients/                        in 0D, with the curve of each artery
  jaxfsi cohort patients/ --mode 3d --workers 2 -- --preset coarse --nominal --rules printed,all
  jaxfsi cohort patients/ --executor dask        on Dask; dask:ADDRESS, slurm:partition=long,time=90
  jaxfsi cohort patients/ --emit-jobs jobs       write an array of jobs for sbatch instead
  jaxfsi cohort patients/ --gather               results of the cases that are finished
  jaxfsi cohort patients.csv                     one row per patient, one column per key of a case
  jaxfsi cohort --demo --out results             the ten virtual children that come with the package

DIR holds NAME/case.toml or NAME.toml for each patient; a CSV file has columns such as patient.id
and condition.rest.ffr (jaxfsi template --csv), and one bad cell refuses the whole file. What
follows -- is passed to the command of each case (run in mode curve, study in mode 3d). Each case
runs in its own process; a failed case does not stop the others, and one lost with its worker or
node is resubmitted, three times at most. Run again, the command resumes the unfinished cases.
Writes cohort.html, cohort.json and a folder with the report of each case.
""",
    ),
    "diagnose": (
        "say where model and measurement differ, which effect explains the gap, and how well",
        """\
examples:
  jaxfsi diagnose record                       a folder with record.toml
  jaxfsi diagnose record --case case.toml      R0 from the patient's case
  jaxfsi diagnose record --case case-results   the ramp's curve from a finished study
  jaxfsi diagnose record --case case-results --in-3d   the gap in the FSI model as well
  jaxfsi diagnose record --richness means      use no more than means of the record

writes diagnosis.json and diagnosis.html. Conditions with held_out = true are predicted and only
then compared. With --in-3d every condition is run in the FSI model too, as calibrated and with the
named effect; the runs are kept in in-3d/, and running the command again resumes them.
""",
    ),
    "import-record": (
        "make a record, and conditions of a case, of catheter files with many beats",
        """\
examples:
  jaxfsi import-record p7_rest.csv p7_ade.csv p7_dobu.csv --out p7
  jaxfsi import-record rest=export1.txt dobutamine=export2.txt --columns time=0,aortic=2,distal=4
  jaxfsi import-record p7_rest.csv --unit kPa --span rest=20:50
  jaxfsi import-record p7_rest.csv p7_dobu.csv p7_equal.csv    wire beside the catheter at the end
  jaxfsi import-record rest=IM0001.dcm dobutamine=IM0002.dcm --id p7     needs jaxfsi[dicom]

FILE is text as the console exports it: any separator, decimal commas, header lines; or DICOM
(Hemodynamic Waveform Storage), whose patient's name and number are not read. Its name says
the condition (..._rest, ..._ade, ..._dobu, ..._equal). Beats are found in the aortic pressure;
extrasystoles and damaged beats are left out. Writes record.toml and a CSV file of whole beats for
each condition (for diagnose), conditions.toml and mean beats (for a case file), and beats.png,
which shows what was used and what was left out. docs/files.md says more.
""",
    ),
    "plan-measurement": (
        "say which measurement would tell the likely causes apart",
        """\
examples:
  jaxfsi plan-measurement record

also says which effects each set of sensors could show at all in the conditions of the record; a
record without any data is enough for that. Writes plan.json.
""",
    ),
    "show": (
        "print a stored result or its JSON Schema; with --out, write its report again",
        """\
examples:
  jaxfsi show case-results
  jaxfsi show case-results/result.json --json
  jaxfsi show case-results --out elsewhere
  jaxfsi show case-results --beside rigid-results --out elsewhere   switch between two walls
  jaxfsi show --schema study                    what the keys of study.json mean, with units
  jaxfsi show --schema case                     what an editor checks a case file with
""",
    ),
    "check": (
        "say what is wrong with case files and records, and what can be run; compute nothing",
        """\
examples:
  jaxfsi check case.toml
  jaxfsi check patients/*.toml record/
  jaxfsi check case.toml --json

prints a line for each fault, FILE:LINE: what is wrong; what to try. The files that a case names are
read too. Exit status: 0 all can be used, 2 there are faults.
""",
    ),
    "template": (
        "print a commented case file or record to start from",
        """\
examples:
  jaxfsi template > case.toml
  jaxfsi template --out new-patient             writes new-patient/case.toml, with its schema
  jaxfsi template --record --out new-record     writes new-record/record.toml and rest.csv
  jaxfsi template --csv > patients.csv          many patients, for cohort
  jaxfsi template --schema > case.schema.json   what an editor checks a case file with

a case is what is known of a patient, for run and study; a record is what was measured, for
diagnose. The schema that is written beside the file lets editors complete its keys and check it.
""",
    ),
    "doctor": (
        "check this installation: packages, devices, meshers, caches, locks left behind",
        """\
examples:
  jaxfsi doctor
  jaxfsi doctor --json

meshes a cube with each mesher in a process of its own, compiles and times a small program, and
looks for what is left in the working folder. Every problem comes with its cure. Exit status: 0 all
is well, 1 something is wrong.
""",
    ),
    "cache": (
        "say what is kept in the cache folder, or remove it",
        """\
examples:
  jaxfsi cache info
  jaxfsi cache clear                 asks first
  jaxfsi cache clear --yes

the cache holds compiled code, meshes and how long steps took. Without it everything is computed
anew, with the same results. Files that jaxfsi did not write stay.
""",
    ),
    "completion": (
        "print a script that lets a shell complete commands and options",
        """\
examples:
  jaxfsi completion bash > ~/.local/share/bash-completion/completions/jaxfsi
  jaxfsi completion zsh > "${fpath[1]}/_jaxfsi"
  jaxfsi completion fish > ~/.config/fish/completions/jaxfsi.fish
""",
    ),
}
"""What each command does in a line, and at length."""
