import sys

import pytest

from support import docs_pages


@pytest.fixture(scope="session")
def reference():
    """The generated pages: file name -> Markdown."""
    sys.path.insert(0, str(docs_pages.DOCS / "reference"))
    try:
        import pages  # noqa: PLC0415
    finally:
        sys.path.pop(0)
    return pages.pages()
