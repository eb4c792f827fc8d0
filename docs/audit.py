"""Known vulnerabilities of what is locked: ``make audit``, or ``python docs/audit.py REQUIREMENTS ...``.

Asks the database of the package index through pip-audit. Exit code 0: nothing is known against any package;
1: something is; 2: the database could not be asked about some of them, so nothing was shown.
"""

import json
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

ASK = ("--progress-spinner", "off", "--disable-pip", "--require-hashes", "--format", "json")


def ask(requirements: str) -> tuple[int, list[str]]:
    """Exit code and lines for the operator, of one file of requirements."""
    with TemporaryDirectory() as folder:
        answer = Path(folder, "answer.json")
        command = ["pip_audit", *ASK, "--output", str(answer), "--requirement", requirements]
        ran = subprocess.run([sys.executable, "-m", *command], capture_output=True, text=True)
        if not answer.exists():
            last = (ran.stderr.strip() or "no answer").splitlines()[-1]
            return 2, [f"{requirements}: NOT audited, the database cannot be asked: {last}"]
        return judge(requirements, json.loads(answer.read_text(encoding="utf-8")))


def judge(requirements: str, answer: dict) -> tuple[int, list[str]]:
    """The same, of what pip-audit says of its packages."""
    packages = answer["dependencies"]
    lines = [
        f"{package['name']} {package['version']}: {', '.join([found['id'], *found.get('aliases', [])])}"
        for package in packages
        for found in package.get("vulns", [])
    ]
    if lines:
        return 1, [f"{requirements}: {len(lines)} known vulnerabilities", *lines]
    silent = [package["name"] for package in packages if "skip_reason" in package]
    if silent:
        why = f"{len(silent)} of {len(packages)} packages, such as {silent[0]}"
        return 2, [f"{requirements}: NOT audited, the index that is reached here knows no answer for {why}"]
    return 0, [f"{requirements}: nothing is known against its {len(packages)} packages"]


def main() -> int:
    found = [ask(requirements) for requirements in sys.argv[1:]]
    for _, lines in found:
        print("\n".join(lines))
    codes = {code for code, _ in found}
    return 1 if 1 in codes else max(codes, default=0)


if __name__ == "__main__":
    sys.exit(main())
