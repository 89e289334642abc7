"""The tool that puts what commands print into the docs."""

from __future__ import annotations

from pathlib import Path

from tests.small_bundle import written
from tools.docs import with_output

PAGE = """Before.

```console
$ isi nearest kettle --top 1
of another day
$ isi nearest kitchen
```

```sh
$ isi nothing
```
"""


def test_output_is_renewed_where_there_is_some(tmp_path: Path) -> None:
    written(tmp_path / "data" / "final_models" / "ai2thor")
    page = with_output(PAGE, tmp_path)
    answer = "entity: kettle\nnearest:\n  entity   kind  cosine\n  kitchen  room  0.802"  # 3 / √14
    assert page == PAGE.replace("of another day", answer)
    assert with_output(page, tmp_path) == page
