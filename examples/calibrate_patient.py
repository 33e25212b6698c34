"""
Calibrate a patient
===================

Calibrate one patient at rest and predict FFR under stress.
"""

# %% The bundled patient: pressures from the case file, R0 from the lumen contours
import equinox as eqx

import calibration
import jaxfsi
import lumped
import study

case = study.read_case(study.demo_case_path())
rest = case.conditions["rest"]
anatomy = case.anatomy
lumen = jaxfsi.read_ivus_contours(anatomy.contours, frame_table=anatomy.first.frame_table)
law = calibration.lumen_law(lumen, mu=case.blood.mu, rho=case.blood.rho_f)
print(f"dP = {law.R0:.0f} Q + {law.K:.0f} Q|Q|  (CGS)")

# %% The paper's linear surrogate: R0 is the tangent of the ramp at 40 mmHg
patient = lumped.Surrogate(R0=law.tangent(40.0 * lumped.MMHG))
condition = lumped.HaemodynamicCondition(rest.P_systolic, rest.P_diastolic, rest.period)
fit = calibration.calibrate_alpha(patient, condition, rest.ffr)
print(f"alpha = {fit.alpha:.4f} in {fit.iterations} step(s)")
print(f"closed form {calibration.alpha_closed_form(patient, condition, rest.ffr):.4f}")

# %% FFR under dobutamine, both readings of the paper's stress rule
patient = eqx.tree_at(lambda s: s.alpha, patient, fit.alpha)
stress = case.conditions["dobutamine"]
condition = lumped.HaemodynamicCondition(stress.P_systolic, stress.P_diastolic, stress.period)
for name in ("printed", "all"):
    network = patient.network(condition, rule=lumped.stress_rule(name))
    numbers = lumped.metrics(lumped.solve_periodic(network, condition.period))
    print(f"{name:8s} FFR {numbers.ratio:.3f}  iFR {numbers.ifr:.3f}")
