"""The compiled filter on disk: numba keeps it beside the source, renewed only where that very file changed.

A function compiled into another one is forgotten so. Hence everything goes when any source file is newer.
"""

from pathlib import Path

import filters

FOLDER = Path(filters.__file__).parent


def drop_stale(folder: Path = FOLDER) -> None:
    """Remove what was compiled before the newest source file in ``folder``, before anything is loaded."""
    kept = [file for kind in ("nbi", "nbc") for file in (folder / "__pycache__").glob(f"*.{kind}")]
    newest = max(source.stat().st_mtime for source in folder.glob("*.py"))
    if any(file.stat().st_mtime < newest for file in kept):
        for file in kept:
            file.unlink(missing_ok=True)
