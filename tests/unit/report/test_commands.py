"""`unlit report` and `unlit view` from the command line."""

import os
import re
import shutil
import signal
import subprocess
import sys
import urllib.request

import pytest

from saved_head import saved_head
from unlit import cli
from unlit.report import comparison, page


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    return saved_head(tmp_path_factory.mktemp("saved")).result


@pytest.fixture(autouse=True)
def small_atlas(monkeypatch):
    monkeypatch.setattr(page, "_ATLAS", 64)


def test_report_is_written_and_named(result, capsys):
    (result / "report.html").unlink(missing_ok=True)
    assert cli.main(["report", str(result)]) == 0
    said = capsys.readouterr()
    assert said.err.startswith("baking the atlas\n")
    assert said.out.strip() == str(result / "report.html")
    assert "<h1>small head" in (result / "report.html").read_text()


def test_two_results_are_compared_on_one_page(result, tmp_path, capsys):
    """Named by their folders; the page is whole; an input that is no result is one line."""
    shutil.copytree(result, tmp_path / "other")
    page = tmp_path / "compared.html"
    assert cli.main(["report", str(result), str(tmp_path / "other"), "-o", str(page)]) == 0
    assert capsys.readouterr().out.strip() == str(page)
    text = page.read_text()
    assert "<h1>result and other" in text
    assert "No settings differ." in text and "normals differ by 0.0 degrees" in text
    assert not re.search(r'(src|href)="(?!data:|#)', text)
    assert cli.main(["report", str(result), str(tmp_path / "absent"), "-o", str(page)]) == 1
    assert "absent" in capsys.readouterr().err


def test_a_folder_whose_name_is_no_text_is_compared(result, tmp_path, capsys):
    """On the page a sign stands for the byte that no encoding knows."""
    odd = tmp_path / os.fsdecode(b"caf\xe9")
    shutil.copytree(result, odd)
    page = tmp_path / "compared.html"
    assert cli.main(["report", str(odd), str(result), "-o", str(page)]) == 0
    assert "<h1>caf\N{REPLACEMENT CHARACTER} and result" in page.read_text()
    assert "relighting caf" in capsys.readouterr().err


def test_a_path_that_is_no_text_is_printed_as_its_bytes(result, tmp_path):
    """A script can open what it reads."""
    odd = tmp_path / os.fsdecode(b"caf\xe9")
    shutil.copytree(result, odd)
    ran = subprocess.run(
        [sys.executable, "-m", "unlit", "montage", odd],
        env=os.environ | {"PYTHONIOENCODING": "utf-8:strict"},
        capture_output=True,
    )
    assert ran.returncode == 0, ran.stderr.decode(errors="replace")
    assert ran.stdout.rstrip() == os.fsencode(odd / "montage.png")


@pytest.mark.parametrize("number", [0, 1])
@pytest.mark.parametrize("name", ["reconstruction.npz", "montage.png"])
def test_a_comparison_spares_the_files_of_both_results(
    result, tmp_path, capsys, monkeypatch, number, name
):
    """Before any work."""
    monkeypatch.setattr(comparison, "load", lambda _: pytest.fail("it began"))
    folders = [shutil.copytree(result, tmp_path / which) for which in "ab"]
    before = (folders[number] / name).read_bytes()
    way = folders[number] / ".." / "ab"[number] / name
    assert cli.main(["report", *map(str, folders), "-o", str(way)]) == 2
    assert f"{way}: is a file of a result" in capsys.readouterr().err
    assert (folders[number] / name).read_bytes() == before


def test_an_output_without_a_second_folder_is_wrong_usage(result, capsys):
    assert cli.main(["report", str(result), "-o", "x.html"]) == 2
    assert "two folders" in capsys.readouterr().err


@pytest.mark.parametrize("command", ["report", "view"])
def test_no_result_is_an_error_of_one_line(command, tmp_path, capsys):
    assert cli.main([command, str(tmp_path / "absent")]) == 1
    assert re.fullmatch(r"unlit: error: .*no such folder.*\n", capsys.readouterr().err)


def test_a_wrong_port_is_wrong_usage(capsys):
    assert cli.main(["view", "x", "--port", "70000"]) == 2
    assert "write a number from 0 to 65535" in capsys.readouterr().err


def test_view_prints_its_address_serves_and_ends_with_ctrl_c(tmp_path):
    """As a process of its own, on a folder whose report is there already."""
    (tmp_path / "report.html").write_text("here it is")
    command = [sys.executable, "-m", "unlit", "view", str(tmp_path), "--no-browser"]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as run:
        assert run.stdout and run.stderr
        address = run.stdout.readline().strip()
        with urllib.request.urlopen(address, timeout=10) as answer:
            assert answer.read() == b"here it is"
        run.send_signal(signal.SIGINT)
        assert run.wait(20) == 0
        assert run.stderr.read() == ""
