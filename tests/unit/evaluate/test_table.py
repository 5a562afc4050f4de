"""Tables: laid out as the paper's, our figures in the right cells."""

import re

from table_of_figures import RESULT
from unlit.evaluate.table import TABLE_2, TABLE_3, markdown, page, tables


def test_tables_2_and_3() -> None:
    """The paper's rows stand first, ours below: gained and raw, face and crop."""
    second, third, every, maps = tables(RESULT)
    flash = [r for r in second.rows if r[0] == "flash"]
    assert flash[3] == ("flash", "the paper", "28.1", "0.065", "24.1", "0.071")
    assert flash[4] == ("flash", "unlit, one gain, face", "31.0", "0.031", "27.0", "0.027")
    assert flash[5][2::2] == ("35.0", "31.0")
    assert flash[6] == ("flash", "unlit, raw, face", "29.0", "0.031", "25.0", "0.027")
    assert third.header[3:] == ("full", "without stage 1")
    ours = {(r[0], r[2]): r[3:] for r in third.rows if r[1].startswith("unlit")}
    assert ours["uniform to flash", "PSNR"] == ("28.0", "22.0")
    assert ours["flash to uniform", "LPIPS"] == ("0.027", "0.021")
    assert len(every.rows) == 8
    assert maps.rows[0][2:6] == ("20.0", "30.0", "1.50", "")


def test_pages() -> None:
    """Every row has as many cells as its header, in Markdown and in HTML; text is escaped."""
    found = tables({"rows": RESULT["rows"][:2]})
    assert all(len(r) == len(t.header) for t in found for r in t.rows)
    text = markdown("A subject", ["a fact"], found)
    assert "| flash | the paper | 28.1 | 0.065 | 24.1 | 0.071 |" in text
    html = page("<b>", ["1 < 2"], found, ["figure.png"])
    assert "&lt;b&gt;" in html and "1 &lt; 2" in html and 'src="figure.png"' in html
    assert len(re.findall("<tr>", html)) == sum(1 + len(t.rows) for t in found)


def test_the_papers_figures_agree_with_each_other() -> None:
    """Table 3's whole schedule is Table 2's cell."""
    for (photo, light), cells in TABLE_3.items():
        psnr, lpips = TABLE_2[photo]["the paper"][light]
        assert cells[0][0] == psnr
        assert abs(float(cells[0][1]) - float(lpips)) < 0.005
        assert len(cells) == 6
