"""The persistent compilation cache: what was compiled once need not be compiled again."""

import os
import pathlib
import sys

import platformdirs

VARIABLE = "JAXFSI_CACHE_DIR"
"""Environment variable with another folder for the cache, or `off`."""


def cache_folder() -> pathlib.Path | None:
    """Folder of the cache: as the environment says, else in the user's cache folder.

    None where the environment switches it off, or the user has no home folder.
    """
    named = os.environ.get(VARIABLE)
    if named is not None:
        return None if named.strip().lower() in ("", "0", "off", "none") else pathlib.Path(named)
    try:
        folder = platformdirs.user_cache_path("jaxfsi", appauthor=False, opinion=False)
    except RuntimeError:
        return None
    return folder if folder.is_absolute() else None


def use_cache() -> pathlib.Path | None:
    """Switch the cache on for this process.

    A cache that cannot be written costs time, no result: it is then left off.

    Returns:
        The folder in use, or None.
    """
    folder = cache_folder()
    if folder is None:
        return None
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return None
    if not os.access(folder, os.W_OK):
        return None
    settings = {
        "jax_compilation_cache_dir": str(folder),
        "jax_persistent_cache_min_compile_time_secs": 0.0,
        "jax_persistent_cache_min_entry_size_bytes": -1,
    }
    for name, value in settings.items():
        if "jax" in sys.modules:
            sys.modules["jax"].config.update(name, value)
        else:  # JAX reads it when it is imported
            os.environ[name.upper()] = str(value)
    return folder
