"""What a result follows from: the content of its inputs, and the options that can change it."""

import hashlib
import json
from collections.abc import Mapping
from typing import Any

from study.store.options import KINDS


def identity(document: Mapping[str, Any]) -> str | None:
    """Hash of what a document follows from; None where it does not say.

    Two results with the same hash come from the same command on the same input: one may take the
    place of the other. Documents of layout 1 do not say, since they hold no options.

    Args:
        document: with its `kind` and `provenance`, see `study.store.provenance`.
    """
    try:
        kind, origin = document["kind"], document["provenance"]
        inputs = sorted((str(entry["file"]), str(entry["sha256"])) for entry in origin["inputs"])
        options = KINDS[kind].read(origin["options"])
        deciding = {n: v for n, v in options.stored().items() if n in options.deciding()}
        text = json.dumps([kind, inputs, deciding], sort_keys=True)
    except (KeyError, TypeError, ValueError, IndexError, AttributeError):
        return None
    return hashlib.sha256(text.encode()).hexdigest()
