"""A tube with a known pressure and motion, its page, and a browser without a window."""

import dataclasses
import json
import os
import pathlib
import shutil
import subprocess
import time
import types

import numpy as np
import pytest

from jaxfsi.anatomy.anatomy import Anatomy, Centerline
from jaxfsi.fields import Entry, frame_name, write_series
from jaxfsi.fields.frame import Grid
from jaxfsi.meshing import tube
from jaxfsi.opening import ANOMALOUS
from jaxfsi.simulation.cycles import CycleMeans, PortMeans
from study.report.vessel_page import vessel_page
from study.report.vessel_scene import ShownRun, vessel_data

LENGTH, RADIUS, PERIOD, FRAMES = 2.0, 0.2, 0.8, 10
BULGE = 0.1
"""Share by which the radius grows over the cycle."""

P_INLET, DROP, PULSE = 100.0, 25.0, 12.0
"""Mean pressure at the inlet, drop to the outlet, amplitude in time [mmHg]."""


def pressure(z, t):
    """Falls as the square of the way: by 25 mmHg in all, so that it crosses 0.80."""
    return P_INLET - DROP * (z / LENGTH) ** 2 + PULSE * np.sin(2.0 * np.pi * t / PERIOD)


def bulge(t):
    """Share by which the radius is larger at an instant."""
    return BULGE * np.sin(np.pi * t / PERIOD) ** 2


def _written(folder, mesh, more=0.0, moves=1.0, frames=FRAMES):
    grid = Grid(mesh.points, mesh.tets, {"region": mesh.region.astype(np.uint8)})
    entries = []
    for k in range(frames + 1):
        t = PERIOD * k / FRAMES
        d = mesh.points * np.array([1.0, 1.0, 0.0]) * moves * bulge(t)
        P = pressure(mesh.points[:, 2], t) - more * mesh.points[:, 2]
        name = frame_name("fields", k)
        fields = {"pressure_mmHg": P.astype(np.float32), "displacement_cm": d.astype(np.float32)}
        grid.write(folder / name, t, fields)
        entries.append(Entry(t, name))
    write_series(folder / "fields.pvd", entries)
    return folder / "fields.pvd"


def _nothing(points):
    """Stands for the shape of an anatomy, which has a mesh already."""
    raise AssertionError(points)


def _cycle(inlet, outlet):
    ports = {
        name: PortMeans(mean, mean - PULSE, mean + PULSE, 0.0, 0.0, 0.0)
        for name, mean in (("inlet", inlet), ("outlet", outlet))
    }
    return CycleMeans(1, True, ports, outlet / inlet, 0.0)


@pytest.fixture(scope="session")
def vessel(tmp_path_factory):
    """Mesh, anatomy, runs and data of a tube at rest and under stress."""
    folder = tmp_path_factory.mktemp("vessel")
    mesh = tube(radius=RADIUS, length=LENGTH, thickness=0.05, n_around=24, n_axial=30, n_layers=1)
    z = np.linspace(0.0, LENGTH, 201)
    line = Centerline(np.stack([0.0 * z, 0.0 * z, z], axis=1), z)
    anatomy = Anatomy("tube", *[_nothing] * 4, (), np.zeros((2, 3)), {ANOMALOUS: line})
    runs = []
    # means of all steps, which those of the frames are near and not equal to
    for condition, more, ends in (("rest", -8.0, (100.4, 91.3)), ("exercise", 0.0, (100.7, 75.4))):
        place = folder / condition
        place.mkdir()
        name = "rest_ratio" if condition == "rest" else "ffr"
        wider = 1.0 + np.arange(len(np.unique(mesh.labelled("interface"))), dtype=float)
        run = ShownRun(
            id=f"loop-{condition}",
            condition=condition,
            rule=None if condition == "rest" else "printed",
            outlet="alpha = 0.11",
            wall="neo-Hookean, 1.5 MPa",
            ratio_name=name,
            measured=0.91 if condition == "rest" else None,
            cycle=_cycle(*ends),
            ratio=ends[1] / ends[0],
            period=PERIOD,
            series=_written(place, mesh, more),
            wider=wider if condition == "exercise" else None,
        )
        runs.append(run)
    data = vessel_data("tube & <b>", mesh, anatomy, runs)
    return types.SimpleNamespace(mesh=mesh, anatomy=anatomy, runs=runs, data=data)


@pytest.fixture(scope="session")
def bare_page(vessel, tmp_path_factory) -> pathlib.Path:
    """The page of a part of a cycle behind a wall that does not move, the artery without axis."""
    first = vessel.runs[0]
    series = first.series.parent.parent / "still" / "fields.pvd"
    series.parent.mkdir()
    _written(series.parent, vessel.mesh, moves=0.0, frames=4)
    cycle = dataclasses.replace(first.cycle, complete=False)
    run = dataclasses.replace(first, wall="rigid", cycle=cycle, series=series)
    data = vessel_data("bare", vessel.mesh, None, [run])
    assert data is not None
    file = tmp_path_factory.mktemp("bare") / "simulation-vessel.html"
    file.write_text(vessel_page(data, None), encoding="utf-8")
    return file


class Browser:
    """Chromium told what to do through a pipe, by its DevTools protocol."""

    def __init__(self, program, profile):
        read, its_write = os.pipe()
        its_read, write = os.pipe()
        flags = [
            "--headless", "--no-sandbox", "--remote-debugging-pipe", "--hide-scrollbars",
            "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--window-size=1400,1000",
            f"--user-data-dir={profile}", "--disable-dev-shm-usage", "--no-first-run",
        ]  # fmt: skip
        told = f'exec "$0" "$@" 3<&{its_read} 4>&{its_write}'
        self.process = subprocess.Popen(
            ["bash", "-c", told, program, *flags],
            pass_fds=(its_read, its_write),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        os.close(its_read)
        os.close(its_write)
        self._read, self._write = os.fdopen(read, "rb", 0), os.fdopen(write, "wb", 0)
        self._rest, self._count, self._session = b"", 0, None

    def call(self, method, **params):
        self._count += 1
        message = {"id": self._count, "method": method, "params": params}
        if self._session:
            message["sessionId"] = self._session
        self._write.write(json.dumps(message).encode() + b"\0")
        while True:
            answer = self._next()
            if answer.get("id") == self._count:
                assert "error" not in answer, answer
                return answer["result"]

    def _next(self):
        while b"\0" not in self._rest:
            more = self._read.read(1 << 16)
            assert more, "the browser ended"
            self._rest += more
        message, self._rest = self._rest.split(b"\0", 1)
        return json.loads(message)

    def open(self, address):
        self._session = None
        target = self.call("Target.createTarget", url=address)["targetId"]
        found = self.call("Target.attachToTarget", targetId=target, flatten=True)
        self._session = found["sessionId"]

    def value(self, expression):
        found = self.call(
            "Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True
        )
        assert "exceptionDetails" not in found, found
        return found["result"].get("value")

    def waited(self, expression, seconds=60.0):
        """A value once it is there."""
        end = time.monotonic() + seconds
        while (found := self.value(expression)) is None:
            assert time.monotonic() < end, f"nothing came of {expression}"
            time.sleep(0.1)
        return found

    def close(self):
        self._session = None
        self._write.write(json.dumps({"id": 0, "method": "Browser.close"}).encode() + b"\0")
        try:
            self.process.wait(20.0)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        self._read.close()
        self._write.close()


@pytest.fixture(scope="session")
def browser(tmp_path_factory):
    names = ("chromium", "chromium-browser", "google-chrome", "chrome")
    program = next((found for name in names if (found := shutil.which(name))), None)
    if program is None:
        pytest.skip("no Chromium on this machine: apt-get install chromium, or Google Chrome")
    browser = Browser(program, tmp_path_factory.mktemp("profile"))
    yield browser
    browser.close()


@pytest.fixture(scope="session")
def page_file(vessel, tmp_path_factory) -> pathlib.Path:
    file = tmp_path_factory.mktemp("page") / "study-vessel.html"
    file.write_text(vessel_page(vessel.data, "study.html"), encoding="utf-8")
    return file
