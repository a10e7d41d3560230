"""Reading Functions: what is no graph is named in one line; graphs as JSON; bad JSON."""

from __future__ import annotations

import json

import casadi as ca
import numpy as np
import pytest

from workbench.graph import Graph, Node, Unreadable, call, evaluate, from_json, read, to_json
from workbench.graph.arithmetic import RATIONALS

m, v = ca.MX.sym("m"), ca.SX.sym("v")
PAIR = ca.MX.sym("pair", 2)


class Sine(ca.Callback):
    """A Function of Python's."""

    def __init__(self):
        ca.Callback.__init__(self)
        self.construct("sine")

    def eval(self, arguments):
        return [ca.sin(arguments[0])]


SINE = Sine()
NEWTON = ca.rootfinder("newton", "newton", {"x": v, "p": ca.SX.sym("p"), "g": v**3 - 1})
UNREADABLE = {
    "logsumexp": (lambda: ca.Function("f", [PAIR], [ca.logsumexp(PAIR)]), "the operation logsumexp in logsumexp(pair)"),
    "solve": (lambda: ca.Function("f", [PAIR], [ca.inv(ca.horzcat(PAIR, PAIR + 1))]), "the operation solve in"),
    "inlined table": (
        lambda: ca.Function("f", [m], [ca.interpolant("t", "linear", [[0, 1, 2]], [0, 1, 4], {"inline": True})(m)]),
        "the operation low in",
    ),
    "Python": (lambda: ca.Function("f", [m], [2 * SINE(m)]), "sine has no form of scalar instructions: it is a Call"),
    "solver": (lambda: ca.Function("f", [m], [NEWTON(1, m)]), "newton has no form of scalar instructions: it is"),
    "table with values to come": (
        lambda: ca.interpolant("t", "linear", [[0.0, 1, 2, 3]], 1),
        "a table whose values or points are inputs is not read",
    ),
    "free": (lambda: ca.Function("f", [v], [v * ca.SX.sym("mass")], {"allow_free": True}), "free variables (mass)"),
}  # fmt: skip


@pytest.mark.parametrize("name", UNREADABLE)
def test_what_is_no_graph_is_named_in_one_line(name):
    made, said = UNREADABLE[name]
    with pytest.raises(Unreadable) as refused:
        read(made())
    assert said in str(refused.value) and "\n" not in str(refused.value)


def test_calls_of_functions_are_written_out():
    inner = ca.Function("inner", [v], [ca.sin(v), 2 * v], {"never_inline": True})
    first, second = inner(v * 3)
    outer = ca.Function("outer", [v], [first * second + inner(v)[1]], ["v"], ["f"])
    graph = read(outer)
    assert {node.op for node in graph.nodes} == {"input", "const", "mul", "sin", "twice", "add"}
    for at in (-1.0, 0.3, 7.0):
        assert call(graph, {"v": at})["f"][0, 0] == float(outer(at))


def test_sparse_inputs_and_outputs_keep_their_places():
    pattern = ca.Sparsity.lower(3)
    matrix = ca.SX.sym("a", pattern)
    f = ca.Function("f", [matrix], [2 * matrix.T], ["a"], ["b"])
    graph = read(f)
    assert graph.coordinates == 6 and graph.inputs[0].places == tuple(zip(*pattern.get_triplet(), strict=True))
    dense = np.tril(np.arange(1.0, 10.0).reshape(3, 3))
    assert np.array_equal(call(graph, {"a": dense})["b"], f(ca.DM(dense)).full())


def test_instruction_for_instruction():
    """Nothing is shared, folded or reordered: two equal products are two nodes."""
    f = ca.Function("f", [v], [(v * v) - (v * v) + 0 * v], ["v"], ["f"])
    graph = read(f)
    instructions = [f.instruction_id(i) for i in range(f.n_instructions())]
    assert len(graph.nodes) == sum(one != ca.OP_OUTPUT for one in instructions)


def test_only_keeps_what_an_output_needs():
    f = ca.Function("f", [v], [ca.sin(v), ca.cos(v) + 1], ["v"], ["s", "c"])
    part = read(f).only("c")
    assert [result.name for result in part.outputs] == ["c"] and "sin" not in {node.op for node in part.nodes}
    assert call(part, {"v": 0.5}) == {"c": f(0.5)[1].full()}


def test_describe_writes_an_expression_and_cuts_it():
    speed, force = ca.SX.sym("speed"), ca.SX.sym("force")
    f = ca.Function("f", [speed, force], [ca.sqrt(speed - 2) * ca.if_else(force < 1, force, 0)], ["v", "u"], ["y"])
    graph = read(f)
    last = graph.output("y").entries[0].node
    assert graph.describe(last) == "((force<1)?(sqrt((speed-2))*force):0)"
    deep = speed
    for _ in range(60):
        deep = ca.sin(deep * deep + force)
    graph = read(ca.Function("f", [speed, force], [deep], ["v", "u"], ["y"]))
    text = graph.describe(graph.output("y").entries[0].node, 40)
    assert len(text) == 40 and text.endswith("...")


GOOD = read(ca.Function("f", [v], [ca.sin(v) + 2], ["v"], ["f"]))


def broken(change):
    content = json.loads(to_json(GOOD))
    change(content)
    return json.dumps(content)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "must be JSON text"),
        ("[1, 2", "must be JSON text"),
        ("[1, 2]", "its format is"),
        (broken(lambda c: c.update(format="workbench.graph/0")), "its format is"),
        (broken(lambda c: c.pop("nodes")), "every part in its form"),
        (broken(lambda c: c["nodes"].__setitem__(1, ["sine", 0])), "must be an operation with its arguments"),
        (broken(lambda c: c["nodes"].__setitem__(1, ["sin", 0, 0])), "must be an operation with its arguments"),
        (broken(lambda c: c["nodes"].__setitem__(0, ["input", 1])), "must be an operation with its arguments"),
        (broken(lambda c: c["nodes"].__setitem__(1, ["sin", 3])), "must have earlier nodes as arguments"),
        (broken(lambda c: c["nodes"].__setitem__(1, ["sin", -1])), "must have earlier nodes as arguments"),
        (broken(lambda c: c["nodes"].__setitem__(1, [])), "not enough values"),
        (broken(lambda c: c["nodes"].__setitem__(2, ["const", "two"])), "hexadecimal"),
        (broken(lambda c: c["outputs"][0]["entries"][0].__setitem__(2, 17)), "must name nodes that exist"),
        (broken(lambda c: c["inputs"][0].update(shape=[1])), "not enough values"),
        (broken(lambda c: c.update(outputs=7)), "every part in its form"),
        (broken(lambda c: c["outputs"][0]["entries"][0].__setitem__(0, 1)), "places within its shape"),
        (broken(lambda c: c["outputs"][0]["entries"].append(c["outputs"][0]["entries"][0])), "name every place once"),
        (broken(lambda c: c["inputs"][0].update(labels=[])), "name every place once"),
        (broken(lambda c: c["inputs"][0].update(places=[[0, -1]])), "places within its shape"),
        (broken(lambda c: c.update(lookups=[[0, 0, [0]]])), "must read an output of a table"),
    ],
)
def test_text_that_is_no_graph(text, said):
    with pytest.raises(ValueError, match=said) as refused:
        from_json(text)
    assert "\n" not in str(refused.value)


def test_the_same_graph_gives_the_same_text():
    assert to_json(from_json(to_json(GOOD))) == to_json(GOOD)


def test_points_and_arithmetics_that_do_not_fit():
    with pytest.raises(ValueError, match="f takes 1 numbers, got 2"):
        evaluate(GOOD, [1.0, 2.0], RATIONALS)
    with pytest.raises(ValueError, match=r"this arithmetic has no sin \(in sin\(v\)\)"):
        evaluate(GOOD, [RATIONALS.constant(1.0)], RATIONALS)
    with pytest.raises(ValueError, match=r"f has inputs \['v'\], got \['x'\]"):
        call(GOOD, {"x": 1.0})
    with pytest.raises(ValueError, match=r"v of f must have shape \(1, 1\), got \(2,\)"):
        call(GOOD, {"v": [1.0, 2.0]})
    with pytest.raises(ValueError, match="must be an operation"):
        Graph(name="g", inputs=(), outputs=(), nodes=(Node("lookup", which=0),))
