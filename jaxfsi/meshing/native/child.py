"""Entry of a child process: ``child.py ADAPTER FOLDER`` runs one adapter on arrays in a folder."""

import importlib.util
import json
import pathlib
import sys

import numpy as np


def main(adapter: pathlib.Path, folder: pathlib.Path) -> int:
    """Read in.npz and options.json, call the adapter's ``run``, write out.npz or error.json."""
    try:
        spec = importlib.util.spec_from_file_location(adapter.stem, adapter)
        assert spec is not None
        assert spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        with np.load(folder / "in.npz") as stored:
            arrays = {key: stored[key] for key in stored.files}
        options = json.loads((folder / "options.json").read_text())
        np.savez(folder / "out.npz", **module.run(arrays, options))
    except Exception as error:
        fault = {"kind": type(error).__name__, "message": str(error)}
        package = getattr(error, "name", None)
        fault["package"] = package.split(".")[0] if package else ""
        (folder / "error.json").write_text(json.dumps(fault))
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main(pathlib.Path(sys.argv[1]), pathlib.Path(sys.argv[2])))
