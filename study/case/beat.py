"""A measured beat of aortic pressure."""

import dataclasses
import pathlib


@dataclasses.dataclass(frozen=True)
class Beat:
    """Samples of one measured beat.

    Attributes:
        path: the file that it was read from.
        t: times [s], uniform from zero, the end of the period left out.
        P_aorta: aortic pressure at these times [dyn/cm²].
    """

    path: pathlib.Path
    t: tuple[float, ...]
    P_aorta: tuple[float, ...]
