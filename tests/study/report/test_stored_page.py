"""Pages of stored results, made again from their documents."""

import json
import pathlib
import re
import shutil

from study.report.stored_page import stored_page
from study.store.stored_document import load_document

EXAMPLES = pathlib.Path(__file__).parent / "documents" / "examples"
_PNG = b"\x89PNG a picture"


def test_page_of_a_stored_study(tmp_path):
    shutil.copy(EXAMPLES / "study.json", tmp_path)
    document = load_document(tmp_path)
    run, names = next(iter(document["pictures"].items()))
    (tmp_path / "study-pictures").mkdir()
    (tmp_path / "study-pictures" / f"{run}-{names[0]}.png").write_bytes(_PNG)
    page = stored_page(tmp_path, document)
    assert document["patient"] in page
    assert page.count("<svg") >= 3
    assert len(re.findall("data:image/png", page)) == 1  # the others are gone
    for row in document["rows"]:
        assert f"{row['fsi']:.4f}" in page


def test_page_of_a_study_marks_an_ffr_at_or_below_the_limit(tmp_path):
    document = json.loads((EXAMPLES / "study.json").read_text(encoding="utf-8"))
    stress = next(row for row in document["rows"] if row["rule"])
    below = re.compile(r'<td class="own below">')
    assert not below.search(stored_page(tmp_path, document))
    stress["fsi"] = 0.80
    assert below.search(stored_page(tmp_path, document))
