"""``python -m isi COMMAND``, and the script ``isi``."""

import sys

try:
    from isi.cli import main
except ModuleNotFoundError as error:
    sys.exit(
        f"isi: {sys.executable} lacks the package {error.name}: activate .venv, or use its `isi`"
    )

if __name__ == "__main__":
    main()
