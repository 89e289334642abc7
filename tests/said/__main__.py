"""The table of what is said, in Markdown: ``python -m tests.said``."""

from __future__ import annotations

from tests.said.every import CASES


def main() -> None:
    print("| read as | what went wrong | what is said | test |\n| --- | --- | --- | --- |")
    for group, cases in CASES.items():
        for case in cases:
            print(f"| {group} | {case.what} | {case.said.replace('|', '&#124;')} | `tests/test_said.py` |")


if __name__ == "__main__":
    main()
