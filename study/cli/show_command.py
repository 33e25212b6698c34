"""The command `show` with `--out`: a page drawn again."""

import argparse

from study.cli.command_output import Answer, note
from study.report.stored_page import page_name, stored_page
from study.store.earlier_run import make_way_for_page
from study.store.folder_lock import at_work
from study.store.output import check_folder, write_files
from study.store.stored_document import Document, readable


def show_command(options: argparse.Namespace, document: Document) -> Answer:
    """Write the page of a stored result again."""
    page = readable(options.result, document, lambda: stored_page(options.result, document))
    folder = check_folder(options.out)
    with at_work(folder, note):
        written = write_files(
            folder,
            {page_name(document): page},
            before=lambda _: make_way_for_page(folder, document, page, note),
        )
    return Answer(document, written)
