"""``docs/licences.md``: the licence of everything that is installed, ``python docs/licences.py`` writes it.

Read from what the packages say of themselves, in an environment that has them. A licence that is not among
``KNOWN`` is shown as it is, and a test refuses it until somebody has read it.
"""

import importlib.metadata
import re
from pathlib import Path

from packaging.utils import canonicalize_name

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "licences.md"
KNOWN = {  # what may be used: name → how packages write it
    "Apache-2.0 or MIT": r"(MIT OR Apache|Apache-2\.0 OR MIT|MIT or Apache)",
    "EPL-2.0 or Apache-2.0": r"EPL.*OR.*Apache|EPL-2\.0|Eclipse Public",
    "NVIDIA, for training only": r"NVIDIA|LicenseRef-NVIDIA",
    "LGPL-3.0": r"LGPL|Lesser General Public",
    "MPL-2.0": r"MPL|Mozilla Public License",
    "MIT-CMU": r"MIT-CMU|HPND",
    "Apache-2.0": r"Apache",
    "BSD": r"BSD|0BSD",
    "PSF-2.0": r"PSF|Python Software Foundation|matplotlib",
    "ISC": r"\bISC\b",
    "Zlib": r"zlib",
    "Unlicense": r"Unlicense|Public Domain",
    "MIT": r"\bMIT\b",
}
ELSEWHERE = {  # not installed on the machine that writes the page, or silent: read at its source
    "colorama": "BSD",
    "cuda-toolkit": "NVIDIA, for training only",
}
HEAD = """\
# Licences

The project is MIT. What it installs, from the lock files and the packages' own words, by
`python docs/licences.py`; a test holds this page against the locks, and refuses a licence that is not among
those known there. None of these packages is shipped with the project: pip fetches them. `pymavlink` is LGPL
and imported as it is; NVIDIA's libraries come with torch, for `gcs train` alone.

| package | version | licence | for |
|---|---|---|---|
"""


def pins(name: str) -> dict[str, str]:
    """Package → version of one lock file."""
    text = (ROOT / "requirements" / f"{name}.txt").read_text(encoding="utf-8")
    return {canonicalize_name(n): v for n, v in re.findall(r"^([\w.-]+)==(\S+)", text, re.MULTILINE)}


def licence(package: str) -> str:
    """One of ``KNOWN``, or what the package says of itself."""
    try:
        about = importlib.metadata.metadata(package)
    except importlib.metadata.PackageNotFoundError:
        return ELSEWHERE.get(package, "not installed")
    classified = [
        c.rpartition(" :: ")[2] for c in about.get_all("Classifier") or [] if c.startswith("License")
    ]
    stated = (about.get("License") or "").strip()
    says = about.get("License-Expression") or ", ".join(classified) or stated.split("\n")[0]
    return next(
        (name for name, words in KNOWN.items() if re.search(words, says, re.I)), says[:60]
    ) or ELSEWHERE.get(package, "none stated")


def page() -> str:
    """The whole page."""
    core, check, everything = pins("core"), pins("check"), pins("test")
    lines = []
    for package, version in sorted(everything.items()):
        use = "every run" if package in core else "tests" if package in check else "training, bench"
        lines.append(f"| {package} | {version} | {licence(package)} | {use} |\n")
    return HEAD + "".join(lines)


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
