"""What the documents and the sources' comments name is there, and imports run one way."""

import ast
import re
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PACKAGE = ROOT / "src" / "unlit"
DOCUMENTS = [
    *(ROOT / name for name in ("README.md", "CONTRIBUTING.md", "SECURITY.md")),
    *sorted((ROOT / "docs").glob("*.md")),
    *sorted((ROOT / "docs" / "tutorials").glob("*.md")),
]
SOURCES = [*sorted(PACKAGE.rglob("*.py")), *sorted((ROOT / "benchmarks").glob("*.py"))]

FILE = re.compile(r"(?<![\w./-])(?:[a-z_0-9]+/)*[a-z_0-9]+\.py\b")
FOLDER = re.compile(r"`((?:[a-z_0-9]+/)+)`")
NAME = re.compile(r"(?<![\w./-])unlit(?:\.[A-Za-z_]\w*)+(?![\w/]|\.\w)")


def exists(path: str) -> bool:
    """Whether `path` is there, below the repository or the package; a bare name anywhere."""
    if (ROOT / path).exists() or (PACKAGE / path).exists():
        return True
    return "/" not in path and path in {file.name for file in PACKAGE.rglob("*.py")}


@cache
def definitions(file: Path) -> dict[str, ast.stmt]:
    """What a module of the package defines or imports, by name; functions' bodies left out."""
    found: dict[str, ast.stmt] = {}
    body = list(ast.parse(file.read_text()).body)
    for node in body:
        if isinstance(node, ast.If):  # `if TYPE_CHECKING`
            body += node.body
        elif isinstance(node, ast.ClassDef | ast.FunctionDef):
            found[node.name] = node
        elif isinstance(node, ast.ImportFrom):
            found |= {(alias.asname or alias.name): node for alias in node.names}
        elif isinstance(node, ast.Assign | ast.AnnAssign):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            found |= {target.id: node for target in targets if isinstance(target, ast.Name)}
    return found


def resolves(name: str) -> bool:
    """Whether the dotted `name` is a module of the package, or is defined in one."""
    parts, place = name.split(".")[1:], PACKAGE
    while parts and (place / parts[0]).is_dir():
        place /= parts.pop(0)
    file = place / "__init__.py"
    if parts and (place / f"{parts[0]}.py").exists():
        file = place / f"{parts.pop(0)}.py"
    if not parts:
        return True
    node = definitions(file).get(parts[0])
    if isinstance(node, ast.ImportFrom) and node.level == 1:
        return resolves(".".join(["unlit", *filter(None, [node.module]), *parts]))
    if isinstance(node, ast.ClassDef) and len(parts) == 2:
        names = {n.name for n in node.body if isinstance(n, ast.FunctionDef)}
        names |= {ast.unparse(n.target) for n in node.body if isinstance(n, ast.AnnAssign)}
        return parts[1] in names
    return node is not None and len(parts) == 1


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: path.name)
def test_what_a_document_names_exists(document: Path) -> None:
    text = document.read_text()
    wrong = {path for path in FILE.findall(text) if not exists(path)}
    wrong |= {path for path in FOLDER.findall(text) if not exists(path)}
    wrong |= {name for name in NAME.findall(text) if not resolves(name)}
    assert not wrong


def test_files_that_comments_name_exist() -> None:
    wrong = {
        (str(file.relative_to(ROOT)), path)
        for file in SOURCES
        for path in FILE.findall(file.read_text())
        if "/" in path and not exists(path)
    }
    assert not wrong


def test_links_between_documents_lead_somewhere() -> None:
    wrong = {
        (document.name, link)
        for document in DOCUMENTS
        for link in re.findall(r"\]\(([\w./-]+)[#\w-]*\)", document.read_text())
        if not (document.parent / link).exists()
    }
    assert not wrong


def test_section_numbers_that_others_give_are_headings() -> None:
    """`docs/method.md, 6.2` in a comment or document has a section 6.2 there."""
    reference = re.compile(r"((?:[\w-]+/)*method[\w-]*\.md)[`)\]]*, (?:section )?(\d+(?:\.\d+)?)\b")
    files = [*SOURCES, *(ROOT / "tests").rglob("*.py"), *(ROOT / "tools").glob("*.py"), *DOCUMENTS]
    found, wrong = 0, set()
    for file in [*files, ROOT / "CHANGELOG.md", *(ROOT / "docs" / "lab").glob("*.md")]:
        for name, number in reference.findall(file.read_text()):
            found += 1
            [page] = (ROOT / "docs").rglob(name.rpartition("/")[2])
            if not re.search(rf"^#+ {re.escape(number)}[. ]", page.read_text(), re.M):
                wrong.add((file.name, name, number))
    assert found > 20
    assert not wrong


def test_the_method_page_stays_short() -> None:
    """Measurements, alternatives and failures belong in docs/lab/."""
    assert len((ROOT / "docs" / "method.md").read_text().split()) < 2500


def test_what_the_glossary_names_is_defined_there() -> None:
    rows = re.findall(
        r"`([a-z_0-9/]+)\.py`, `([\w.]+)` \|", (ROOT / "docs" / "glossary.md").read_text()
    )
    assert len(rows) > 40
    names = {f"unlit.{module.replace('/', '.')}.{name}" for module, name in rows}
    assert not {name for name in names if not resolves(name)}


def test_rooms_import_only_what_the_house_puts_before_them() -> None:
    table = re.findall(
        r"^\| ((?:`[\w./]+`(?:, )?)+) \|", (ROOT / "docs" / "house.md").read_text(), re.M
    )
    rank = {
        re.sub(r"\.py$|/$", "", place): row
        for row, places in enumerate(table)
        for place in re.findall(r"`([\w./]+)`", places)
    }
    rooms = {folder.name for folder in PACKAGE.iterdir() if (folder / "__init__.py").exists()}
    assert rooms <= set(rank)
    wrong = set()
    for file in SOURCES:
        room, *rest = file.relative_to(ROOT).with_suffix("").parts[2:] or [""]
        for node in ast.walk(ast.parse(file.read_text())) if room in rank else ():
            if isinstance(node, ast.ImportFrom) and node.level == len(rest) + 1:
                modules = [node.module] if node.module else [alias.name for alias in node.names]
                targets = {module.split(".")[0] for module in modules}
                wrong |= {(str(file), name) for name in targets if rank[name] > rank[room]}
    assert not wrong
