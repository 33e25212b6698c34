"""Files of arrays: what they announce is compared with what they hold before any is made."""

import io
import tracemalloc
import zipfile

import numpy as np
import pytest

from jaxfsi.fields.npz import load_arrays


def header(shape: tuple[int, ...]) -> bytes:
    buffer = io.BytesIO()
    np.lib.format.write_array_header_1_0(
        buffer, {"descr": "<f8", "fortran_order": False, "shape": shape}
    )
    return buffer.getvalue()


def test_arrays_are_read_as_they_were_written(tmp_path):
    path = tmp_path / "a.npz"
    given = {"a": np.arange(6.0).reshape(2, 3), "b": np.array("text"), "c": np.zeros((0, 3))}
    np.savez(path, **given)  # pyright: ignore[reportArgumentType]
    found = load_arrays(path)
    assert found.keys() == given.keys()
    for name, values in given.items():
        np.testing.assert_array_equal(found[name], values)


@pytest.mark.parametrize("way", ["packed zeros", "declared", "cut", "no zip", "pickle"])
def test_what_announces_more_than_it_holds_is_refused(tmp_path, way):
    path = tmp_path / "a.npz"
    np.savez(path, a=np.arange(100.0))
    if way == "packed zeros":
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as store:
            store.writestr("a.npy", header((2**22,)) + bytes(2**25))
    elif way == "declared":
        with zipfile.ZipFile(path, "w") as store:
            store.writestr("a.npy", header((2**36,)) + bytes(80))
    elif way == "cut":
        path.write_bytes(path.read_bytes()[:300])
    elif way == "no zip":
        path.write_bytes(b"text")
    else:
        np.savez(path, a=np.array([{}], dtype=object))
    tracemalloc.start()
    with pytest.raises(ValueError, match=r"it |its |announces ") as caught:
        load_arrays(path)
    assert tracemalloc.get_traced_memory()[1] < 1e7
    tracemalloc.stop()
    assert "pickle" not in str(caught.value)
