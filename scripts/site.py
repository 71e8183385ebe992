"""What mkdocs does to a page before it is rendered (`hooks` in mkdocs.yml)."""

from typing import Any


def on_page_markdown(markdown: str, **_: Any) -> str:
    """A block that no test runs is marked so for the tests; for the site it is Python."""
    return markdown.replace("```python no-run\n", "```python\n")
