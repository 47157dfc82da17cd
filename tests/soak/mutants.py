"""Small changes to a module, one at a time, told in a line of source: the mutants of `tests.soak.mutation`.

Comparisons and computations are turned into their opposites, `and` into `or`, conditions around, flags over, and
numbers become something else. What only describes (docstrings, what decorates a class) is left alone.
"""

from __future__ import annotations

import ast
import copy
from collections.abc import Iterator
from dataclasses import dataclass

OPPOSITES = ((ast.Lt, ast.GtE), (ast.LtE, ast.Gt), (ast.Eq, ast.NotEq), (ast.Is, ast.IsNot), (ast.In, ast.NotIn))
COMPARED = {**dict(OPPOSITES), **{other: one for one, other in OPPOSITES}}
COMPUTED = {ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult}


@dataclass(frozen=True)
class Mutant:
    """One change.

    Attributes:
        line: Where.
        change: What, as ``before -> after``.
        text: The whole module with it.
    """

    line: int
    change: str
    text: str


class _Mutator(ast.NodeTransformer):
    """Makes the change of one number, and counts how many there are."""

    def __init__(self, wanted: int) -> None:
        self.wanted, self.count, self.line, self.before, self.after = wanted, 0, 0, "", ""

    def _mine(self, node: ast.expr) -> bool:
        self.count += 1
        if self.count - 1 != self.wanted:
            return False
        self.line, self.before = node.lineno, ast.unparse(node)
        return True

    def _became(self, node: ast.expr) -> ast.expr:
        self.after = ast.unparse(node)
        return node

    def visit_ClassDef(self, node: ast.ClassDef) -> ast.AST:
        node.body = [self.visit(each) for each in node.body]
        return node

    def visit_Compare(self, node: ast.Compare) -> ast.AST:
        self.generic_visit(node)
        for at, operator in enumerate(node.ops):
            if type(operator) in COMPARED and self._mine(node):
                node.ops[at] = COMPARED[type(operator)]()
                return self._became(node)
        return node

    def visit_BinOp(self, node: ast.BinOp) -> ast.AST:
        self.generic_visit(node)
        if type(node.op) in COMPUTED and self._mine(node):
            node.op = COMPUTED[type(node.op)]()
            return self._became(node)
        return node

    def visit_BoolOp(self, node: ast.BoolOp) -> ast.AST:
        self.generic_visit(node)
        if self._mine(node):
            node.op = ast.Or() if isinstance(node.op, ast.And) else ast.And()
            return self._became(node)
        return node

    def visit_UnaryOp(self, node: ast.UnaryOp) -> ast.AST:
        self.generic_visit(node)
        if isinstance(node.op, ast.Not) and self._mine(node):
            return self._became(node.operand)
        return node

    def visit_Constant(self, node: ast.Constant) -> ast.AST:
        if isinstance(node.value, bool):
            other: ast.expr = ast.Constant(not node.value)
        elif isinstance(node.value, int | float):
            other = ast.Constant(node.value * 2 + 1)
        else:
            return node
        return self._became(ast.copy_location(other, node)) if self._mine(node) else node


def mutants(source: str) -> Iterator[Mutant]:
    """Every mutant of a module."""
    tree, number = ast.parse(source), 0
    while True:
        mutator = _Mutator(number)
        changed = mutator.visit(copy.deepcopy(tree))
        if mutator.count <= number:
            return
        text = ast.unparse(ast.fix_missing_locations(changed))
        yield Mutant(mutator.line, f"{mutator.before} -> {mutator.after}", text)
        number += 1
