"""Damage to the bytes of a file, whatever it holds; and other things in place of a file."""

import random
from collections.abc import Callable

from tests.fuzz.trial import Content, Expected, Fifo, Folder, Link

Damage = tuple[Content, Expected]
Operator = Callable[[random.Random, bytes], Damage]


def flipped(rng: random.Random, data: bytes) -> Damage:
    """Some bits are others."""
    changed = bytearray(data)
    for _ in range(rng.choice([1, 1, 3, 20])):
        changed[rng.randrange(len(changed))] ^= 1 << rng.randrange(8)
    return bytes(changed), "either"


def truncated(rng: random.Random, data: bytes) -> Damage:
    """The file ends early."""
    return data[: rng.randrange(len(data))], "either"


def spliced(rng: random.Random, data: bytes) -> Damage:
    """A piece of the file stands elsewhere in it."""
    a, b = sorted(rng.randrange(len(data)) for _ in range(2))
    piece = data[a : min(b, a + 200)]
    at = rng.randrange(len(data))
    if rng.random() < 0.5:
        return data[:at] + piece + data[at:], "either"
    return data[:at] + piece + data[at + len(piece) :], "either"


def nul_bytes(rng: random.Random, data: bytes) -> Damage:
    """Zero bytes inside."""
    at = rng.randrange(len(data))
    return data[:at] + b"\0" * rng.choice([1, 4, 512]) + data[at:], "refused"


def all_nul(_: random.Random, data: bytes) -> Damage:
    """What a file system leaves after a power cut."""
    return b"\0" * len(data), "refused"


def empty(rng: random.Random, _: bytes) -> Damage:
    return rng.choice([b"", b" ", b"\n\n\t\n", b"\xef\xbb\xbf"]), "refused"


def utf16(rng: random.Random, data: bytes) -> Damage:
    text = data.decode("utf-8", "replace")
    return text.encode(rng.choice(["utf-16", "utf-16-le", "utf-16-be", "utf-32"])), "refused"


def latin1(_: random.Random, data: bytes) -> Damage:
    """A remark in another encoding."""
    return b"# Messung f\xfcr S\xe4ugling\n" + data, "refused"


def marked(_: random.Random, data: bytes) -> Damage:
    """A byte-order mark in front, as Windows programs write it."""
    return b"\xef\xbb\xbf" + data, "same"


def binary(rng: random.Random, data: bytes) -> Damage:
    """Another file altogether."""
    head = rng.choice([b"\x89PNG\r\n\x1a\n", b"PK\x03\x04", b"\x1f\x8b\x08", b"%PDF-1.7\n", b"MZ"])
    return head + rng.randbytes(len(data) % 5000 + 100), "refused"


def no_file(rng: random.Random, _: bytes) -> Damage:
    """Something else in place of a file."""
    return rng.choice([Folder(), Fifo(), Link("nowhere"), Link("/dev/null"), Link(".")]), "refused"


def endless(rng: random.Random, _: bytes) -> Damage:
    """A device that never ends."""
    return Link(rng.choice(["/dev/zero", "/dev/urandom"])), "refused"


BYTE_OPERATORS: dict[str, Operator] = {
    "flipped": flipped,
    "truncated": truncated,
    "spliced": spliced,
    "nul bytes": nul_bytes,
    "all nul": all_nul,
    "empty": empty,
    "utf-16": utf16,
    "latin-1": latin1,
    "marked": marked,
    "binary": binary,
    "no file": no_file,
    "endless": endless,
}
