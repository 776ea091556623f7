"""Weight of code: what layout, names and the extraction of private helpers do not
change.

    python -m tests.support.weight FOLDER...

Counted are calls, attributes, subscripts, operators, comparisons, each operand of `and`
and `or` after the first, branches, literals, imported names, classes, fields and public
functions. Not counted are names, assignments, annotations, docstrings, comments,
private `def` lines, calls of private functions of the same module, `append` and
`extend`.
"""

import ast
import io
import sys
import tokenize
from pathlib import Path

BRANCHES = (
    *(ast.If, ast.IfExp, ast.match_case, ast.ExceptHandler),
    *(ast.For, ast.While, ast.With),
)
DEFINITIONS = (ast.FunctionDef, ast.AsyncFunctionDef)
LAYOUT = {
    *(tokenize.NEWLINE, tokenize.NL, tokenize.INDENT, tokenize.DEDENT),
    *(tokenize.COMMENT, tokenize.ENDMARKER, tokenize.ENCODING),
}


def weight(text: str) -> int:
    """Weight of the source `text` of a module."""
    tree = ast.parse(text)
    private = {
        node.name
        for node in tree.body
        if isinstance(node, ast.FunctionDef) and node.name.startswith("_")
    }
    ignored = set(_docstrings(tree)) | set(_annotations(tree))
    nodes = (node for node in ast.walk(tree) if node not in ignored)
    return sum(_node_weight(node, private) for node in nodes)


COUNTED = (
    *(ast.Call, ast.Attribute, ast.Subscript, ast.ClassDef, *BRANCHES),
    *(ast.BinOp, ast.AugAssign, ast.UnaryOp, ast.Constant, ast.JoinedStr),
)


def _node_weight(node: ast.AST, private: set[str]) -> int:
    count = int(isinstance(node, COUNTED))
    match node:
        case ast.Call(func=ast.Name(id=name)):
            count = int(name not in private)
        case ast.Call(func=ast.Attribute(attr="append" | "extend")):
            count = -1  # of its attribute, which is counted by itself
        case ast.Compare():
            count = len(node.ops)
        case ast.BoolOp():
            count = len(node.values) - 1
        case ast.comprehension():
            count = 1 + len(node.ifs)
        case ast.Import() | ast.ImportFrom():
            count = len(node.names)
        case ast.FunctionDef() | ast.AsyncFunctionDef():
            count = int(not node.name.startswith("_"))
        case ast.AnnAssign():
            count = int(node.value is None)
    return count


def _docstrings(tree: ast.Module) -> list[ast.AST]:
    """Constants that are the docstring of a definition or of the module."""
    found: list[ast.AST] = []
    for node in ast.walk(tree):
        if not isinstance(node, (*DEFINITIONS, ast.ClassDef, ast.Module)):
            continue
        match node.body:
            case [ast.Expr(value=ast.Constant() as text), *_]:
                found.append(text)
    return found


def _annotations(tree: ast.Module) -> list[ast.AST]:
    """All nodes inside annotations and return types."""
    found: list[ast.AST] = []
    for node in ast.walk(tree):
        for field in ("annotation", "returns"):
            annotation = getattr(node, field, None)
            if isinstance(annotation, ast.AST):
                found += ast.walk(annotation)
    return found


def tokens_a_line(text: str) -> tuple[int, int]:
    """Tokens and code lines of the source `text`, docstrings and comments left out."""
    documented = {
        line
        for node in _docstrings(ast.parse(text))
        for line in range(node.lineno, node.end_lineno + 1)
    }
    tokens = [
        token
        for token in tokenize.generate_tokens(io.StringIO(text).readline)
        if token.type not in LAYOUT and token.start[0] not in documented
    ]
    code = {
        line for token in tokens for line in range(token.start[0], token.end[0] + 1)
    }
    return len(tokens), len(code)


def _main() -> None:
    for root in map(Path, sys.argv[1:]):
        files = sorted(root.rglob("*.py")) if root.is_dir() else [root]
        texts = [path.read_text(encoding="utf-8") for path in files]
        counts = [tokens_a_line(text) for text in texts]
        tokens, code = (sum(numbers) for numbers in zip(*counts, strict=True))
        print(
            f"{root}: weight {sum(map(weight, texts))}, modules {len(files)},"
            f" {tokens / code:.2f} tokens a code line"
        )


if __name__ == "__main__":
    _main()
