"""A stand-in for the 3D march of a run with a bed: the surrogate of its artery, in 0D."""

import numpy as np

from jaxfsi.simulation import StepHistory
from lumped import Fourier, PressureSource, Vessel, connect, solve_periodic
from study.run.simulation_data import Outcome


class QuickMarch:
    """Stands in for `run_simulation`: the bed behind a linear artery, periodic from the start."""

    def __init__(self, R0: float, C0: float):
        self.R0, self.C0, self.folders = R0, C0, []

    def __call__(self, case, setup, folder, progress):
        self.folders.append(folder.name)
        plan, names = setup.schedule, setup.model.names
        parts = {
            "inlet": (PressureSource(setup.inlet), "aorta"),
            "ostium": (Vessel(R_viscous=self.R0, C=self.C0), "aorta", "d"),
            "coronary": (setup.outlets.blocks["anomalous_outlet"], "d"),
        }
        found = solve_periodic(connect(parts), plan.period, Fourier(n_samples=1024))
        t = plan.dt * np.arange(1, plan.n_steps + 1)
        P, Q = np.zeros((2, t.size, len(names)))

        def at(values):
            return np.interp(t % plan.period, found.t, np.asarray(values), period=plan.period)

        P[:, names.index("aorta_inlet")] = at(found.pressure("aorta"))
        P[:, names.index("anomalous_outlet")] = at(found.pressure("d"))
        Q[:, names.index("anomalous_outlet")] = at(found.flow("ostium"))
        ones, counts = np.ones(t.size), np.ones(t.size, int)
        record = StepHistory(ones, t, 0.0 * t + plan.dt, P, Q, counts, counts, ones, ones, ones)
        return Outcome(record, [], None, None, 0.0, state=setup.state)
