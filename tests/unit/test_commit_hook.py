"""Hook of the repository for commit messages."""

import subprocess
from pathlib import Path

import pytest

HOOK = Path(__file__).parents[2] / ".githooks" / "commit-msg"


@pytest.mark.parametrize(
    ("message", "is_allowed"),
    [
        ("verify: compare all pairs\n\nNeighbours are not enough.\n", True),
        ("verify: compare all pairs\n", True),
        ("importers/ros: " + "x" * 45 + "\n", True),
        ("importers/ros: " + "x" * 46 + "\n", False),
        ("verify: compare all pairs.\n", False),
        ("Compare all pairs\n", False),
        ("verify: compare all pairs\nNo blank line.\n", False),
    ],
)
def test_commit_messages_have_one_form(tmp_path, message, is_allowed):
    file = tmp_path / "message"
    file.write_text(message)
    done = subprocess.run(["sh", str(HOOK), str(file)], check=False, capture_output=True, text=True)
    assert (done.returncode == 0) is is_allowed, done.stderr
