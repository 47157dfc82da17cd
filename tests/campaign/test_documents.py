"""What `docs/campaign.md` says of a row."""

import re
from pathlib import Path

from ridlink.campaign.table import Row

PAGE = Path(__file__).resolve().parents[2] / "docs" / "campaign.md"


def test_every_key_of_a_row_is_on_the_page():
    section = PAGE.read_text().partition("## What a row says")[2].partition("\n## ")[0]
    first_columns = [line.split("|")[1] for line in section.splitlines() if line.startswith("| `")]
    assert sorted(re.findall(r"`(\w+)`", " ".join(first_columns))) == sorted(Row.__slots__)
