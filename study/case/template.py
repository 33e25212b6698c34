"""The template of a case file, with every key that it takes."""

_TEMPLATE = """\
# A patient case. Every key that carries a unit ends in it. Lines that begin with "#name =" or "#["
# are optional and show the default, or an example where it says so; remove the "#" to set them.
# Any table takes source = "..." (where its values come from) and notes = "...".

[patient]
id = "patient-01"                   # names the results: letters, digits, ". _ -"
#source = "catheter report"
#notes = "free text"

# The vessel: exactly one kind. Leave it out where R0 is given below and nothing needs a mesh.
#[anatomy]
#kind = "ivus"                      # ivus | synthetic | surface | mesh
#contours = "contours.csv"          # ivus: tab-separated frame, x, y, z in mm; beside this file
#frame_table = "frames.csv"         # ivus, example: frame, position, measurement_1 (tissue), in mm
#reference_point = "reference.csv"  # ivus, example: frame, x, y, z in mm, on the aortic side
#centerline = "centerline.csv"      # ivus, example: x, y, z in mm; a mesh needs it and the radius
#aorta_radius_mm = 14.0             # ivus, example
#septum_mm = 0.8                    # ivus, example: tissue where no frame table tells it
#take_off_angle_deg = 40.0          # ivus, as the next five
#aorta_below_mm = 20.0
#aorta_above_mm = 20.0
#distal_extension_mm = 5.0
#fillet_mm = 0.6
#ostium_end = "auto"                # auto | first | last point of the centre line
#[anatomy.states.rest_systole]      # further pullbacks: CONDITION_diastole or CONDITION_systole
#contours = "contours.csv"
#frame_table = "frames.csv"
#reference_point = "reference.csv"
# synthetic: side = "left" | "right", body_surface_area_m2, and any of take_off_angle_deg,
#            ostium_major_mm, ostium_minor_mm, intramural_length_mm, septum_mm, hypoplasia,
#            ellipticity, reference_radius_mm, tube_radius_mm, ... (all of SyntheticAnatomy)
# surface:   surface = "lumen.stl" (STL, PLY, OBJ, VTP), unit = "mm" | "cm", smoothing_steps = 10;
#            [anatomy.openings] aorta_inlet = [x, y, z], ... names the vessel ends; inlet and
#            outlet (outlet_1, ...) those of a coronary artery without the aorta, for simulate;
#            [anatomy.cuts.NAME] centre, normal, radius cuts a vessel that has no flat end
# mesh:      path = "mesh.vtu", or fluid = "..." and solid = "..." (mesh-complete folders),
#            unit = "mm" | "cm"; [anatomy.labels] OLD = "NEW" renames openings and surfaces

#[blood]
#viscosity_poise = 0.04
#density_g_per_cm3 = 1.06

#[wall]
#E_dyn_per_cm2 = 1.5e7
#nu = 0.49
#density_g_per_cm3 = 1.0
#material = "saint_venant_kirchhoff" # linear | saint_venant_kirchhoff | neo_hookean
#element = "linear"                 # linear | quadratic: bends, and takes some ten times as long
#prestress = "diastole"             # diastole: the image shows the wall under that pressure | none
#thickness_per_radius = 0.1         # or { factor = 0.1, min_mm = 0.3, max_mm = 2.0 }

# The condition at rest. ffr is the measured mean distal over mean aortic pressure (resting Pd/Pa):
# calibration needs it.
[condition.rest]
P_systolic_mmHg = 110.0
P_diastolic_mmHg = 65.0
period_s = 0.80                     # 60 / heart rate
ffr = 0.91
#ffr_sd = 0.01                      # example
#cardiac_output_l_per_min = 4.5     # example
#stroke_volume_ml = 60.0            # example
#waveform = "rest_beat.csv"         # example: one measured beat, columns time_s,P_aorta_mmHg

# Any number of further conditions, under any name; all of them are stress.
[condition.dobutamine]
P_systolic_mmHg = 130.0
P_diastolic_mmHg = 70.0
period_s = 0.45
#kind = "stress"                    # of every condition but rest

# The coronary outlet at rest, before calibration.
#[coronary]
#R_1_dyn_s_per_cm5 = 3.1992e4
#R_2_dyn_s_per_cm5 = 6.3984e4
#R_3_dyn_s_per_cm5 = 2.666e5
#C_a_cm5_per_dyn = 4.5e-7
#C_im_cm5_per_dyn = 3.0e-6
#P_venous_mmHg = 0.0
#im_factor = 1.0                    # factor of the ventricular pressure

# The anomalous artery in 0D, dP = R0 Q + K Q |Q|. Under the linear law the resting ratio fixes
# alpha/R0, so that FFR does not depend on R0: jaxfsi run needs none, only alpha and flow do.
[surrogate]
R0_dyn_s_per_cm5 = 5.0e3            # or R0_mmHg_s_per_ml = 3.75; with an sd of its logarithm:
# R0_dyn_s_per_cm5 = { value = 5.0e3, sd_log = 0.15 }; may be left out with an ivus anatomy
#C0_cm5_per_dyn = 1.0e-7
#law = "linear"                     # linear | quadratic
#K_dyn_s2_per_cm8 = 1.0e3           # example, or K_mmHg_s2_per_ml2; used where law = "quadratic"

# From rest to stress: "printed" or "all" (two readings of the published rule), or own factors.
#[stress]
#rule = "printed"
# [stress.factors] takes R_1, R_2, R_3, C_a, C_im (each 1.0 where absent) in place of rule.

# In series behind the aorta in 3D: its characteristic impedance, or the paper's 10 dyn s/cm5.
#[windkessel]
#characteristic = "impedance"       # impedance | paper

#[mesh]
#preset = "medium"                  # coarse | medium | fine: 30k, 150k, 500k tetrahedra
#elements_across = 8                # example: at least so many across the narrowest width
#wall_layers = 2
#backend = "netgen"                 # netgen | gmsh | tetgen
#unit = "cm"                        # of the mesh files: cm | mm

#[solver]
#dt_s = 1.0e-3                      # example: step of a 3D run
#cycles = 4                         # example: cycles of a 3D run
#n_steps = 1000                     # example: samples of a cycle in 0D
#frames_per_cycle = 40              # example, 3D: fields written in a cycle
#checkpoint_every = 100             # example, 3D: steps between two checkpoints
#tolerance = 1.0e-3                 # example, 3D: by how much the residual of a step is reduced
#max_halvings = 4                   # example, 3D: how often a step that fails may be halved
#change_limit = 0.03                # example, 3D: adaptive steps; absent: steps of equal length
"""


def case_template() -> str:
    """A commented case file to start from; it is itself a valid case."""
    return _TEMPLATE
