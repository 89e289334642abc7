"""Mine a source into a table, in a process that reports what it took.

python -m tests.mined '{"reader": "procthor_houses", "path": "houses.jsonl.gz", ...}' table.parquet
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path

from isi.sources import OBSERVATIONS, Source
from tests.houses import peak_mib


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("settings", type=json.loads, help="of the source, as JSON")
    parser.add_argument("table", type=Path)
    given = parser.parse_args()
    start = time.perf_counter()
    source = Source(given.settings, "sources.mined", 0)
    rows = OBSERVATIONS.write_parts(given.table, source.tables(), "mined")
    seconds = round(time.perf_counter() - start, 1)
    print(json.dumps({"observations": rows, "counts": source.counts, "seconds": seconds, "peak_mib": peak_mib()}))


if __name__ == "__main__":
    main()
