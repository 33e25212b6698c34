"""The command `show` with `--out`: a page drawn again."""

from study.cli.command_output import Answer, note
from study.cli.request import Request, ShowOptions
from study.report.stored_page import page_name, stored_page
from study.report.stored_vessel import stored_vessel, vessel_beside
from study.report.study_vessel import vessel_name, vessel_pages
from study.store.earlier_run import make_way_for_page
from study.store.folder_lock import at_work
from study.store.output import check_folder, write_files
from study.store.stored_document import Document, readable


def show_command(request: Request[ShowOptions], document: Document) -> Answer:
    """Write the page of a stored result again."""
    result = request.options.result
    assert result is not None, "else a schema is shown"
    place, kind = result if result.is_dir() else result.parent, document["kind"]
    vessel = vessel_beside(stored_vessel(place, kind), result, request.options.beside)
    linked = vessel_name(vessel, kind)
    page = readable(result, document, lambda: stored_page(result, document, linked))
    assert request.out is not None, "without it the result is printed"
    folder = check_folder(request.out)
    with at_work(folder, note):
        written = write_files(
            folder,
            {**vessel_pages(vessel, kind), page_name(document): page},
            before=lambda _: make_way_for_page(folder, document, page, note),
        )
    return Answer(document, written)
