"""What joins nodes in a deck: ties, rigid bodies, couplings, bolts and equations."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Final

import numpy as np

from ..arrays import FloatArray, IntArray
from .cards import Card, key_of
from .contacts import tied_pairs
from .equations import Equations
from .node_surfaces import EDGES, named_sides
from .reading import Reading
from .rigid_bodies import skin_of
from .steps import Rows, Step, Tracks

_AtReference = tuple[str, int, int]
"""What a reference node belongs to, its number among these, and the degree of freedom."""

_SMALL_TURN: Final = 0.1
"""Rotation in radians up to which displacements that are linear in it are right to 5 %."""

_IN_FRAME: Final = "is the reference of a face or a bolt, and has a *TRANSFORM: give what it does along x, y and z"


class Constraints:
    """The constraints of a deck with what is prescribed at their reference nodes.

    Attributes:
        cuts: The faces along which bodies are cut, for the sections of bolts.
    """

    def __init__(self, reading: Reading):
        self._of = reading
        self._loads, self._held = Tracks[_AtReference](support=False), Tracks[_AtReference](support=True)
        self._rigid: list[dict[str, Any]] = []
        self._bolts: list[dict[str, Any]] = []
        self.cuts: list[str] = []
        self._of_node: dict[int, tuple[str, int]] = {}
        self._equations = Equations(reading)
        coupling: Card | None = None
        for card in reading.model:
            if card.kind == "COUPLING":
                coupling = card
            elif card.kind in ("KINEMATIC", "DISTRIBUTING") and coupling is not None:
                self._coupled(coupling, card)
            elif card.kind in ("KINEMATICCOUPLING", "DISTRIBUTINGCOUPLING"):
                self._coupled_nodes(card)
            elif card.kind == "RIGIDBODY":
                self._rigid_body(card)
            elif card.kind == "PRE-TENSIONSECTION":
                self._bolt(card)
            elif card.kind == "EQUATION":
                self._equations.take(card)
            elif card.kind == "MPC":
                self._equations.stay(card)
        both = self._equations.references & self._of_node.keys()
        if both:
            node = self._of.deck.called(min(both))
            raise ValueError(
                f"{reading.deck.place_of(node)}: node {node} is in an equation, and the reference of a face or a bolt"
            )
        self._of_node |= {node: ("equation", node) for node in self._equations.references}

    def _reference(self, card: Card, name: str) -> int:
        nodes = np.unique(self._of.node_numbers(card.needs(name), card, None))
        if len(nodes) != 1:
            raise card.fault(f"{name} should be one node, but {card.get(name)!r} has {len(nodes)}")
        return int(nodes[0])

    def _point(self, node: int) -> list[float]:
        return [float(one) for one in self._of.point(node)]

    def _coupled(self, coupling: Card, kind: Card) -> None:
        node = self._reference(coupling, "REFNODE")
        face = self._of.face(coupling.needs("SURFACE"), coupling)
        if coupling.get("ORIENTATION"):
            raise coupling.fault("degrees of freedom in axes of their own (ORIENTATION) are not read")
        if coupling.key("INFLUENCERADIUS") not in ("", "WHOLESURFACE"):
            raise coupling.fault("a coupling of a part of its surface (INFLUENCE RADIUS) is not read")
        if kind.kind == "DISTRIBUTING":
            if kind.key("WEIGHTINGMETHOD") not in ("", "UNIFORM"):
                raise kind.fault("weights by distance (WEIGHTING METHOD) are not read")
            if self._is_held(node):
                self._equations.mean_motion(node, self._areas_on(coupling), coupling)
                return
            self._of_node[node] = ("distributing", len(self._rigid))
            self._rigid.append({"face": face, "point": self._point(node), "spread": True})
            return
        held = set(range(1, 7)) if not kind.lines else set()
        for row, words in kind.rows():
            held |= set(kind.freedoms(words, row))
        if not {1, 2, 3} <= held:
            if node in self._of.frames:
                raise coupling.fault(f"node {coupling.get('REFNODE')} {_IN_FRAME}")
            self._equations.couple(node, self._nodes_on(coupling), held)
            return
        self._of_node[node] = ("rigid", len(self._rigid))
        self._rigid.append({"face": face, "point": self._point(node)})

    def _coupled_nodes(self, card: Card) -> None:
        """Abaqus' *KINEMATIC COUPLING: nodes with the degrees of freedom that follow the reference node; and
        CalculiX' *DISTRIBUTING COUPLING: nodes with the weights of the mean that it follows."""
        if card.kind == "KINEMATICCOUPLING":
            node = self._reference(card, "REFNODE")
            if card.get("ORIENTATION"):
                raise card.fault("degrees of freedom in axes of their own (ORIENTATION) are not read")
        else:
            element = self._of.deck.element_sets.members(self._of.set_name(card))
            rows = np.vstack(self._of.deck.elements.get("DCOUP3D", [np.empty((0, 2), dtype=np.int64)]))
            found = rows[np.isin(rows[:, 0], element), 1]
            if len(found) != 1:
                raise card.fault(f"ELSET={card.get('ELSET')} should be one element DCOUP3D, but has {len(found)}")
            node = int(found[0])
        if node in self._of.frames:
            raise card.fault(f"node {self._of.deck.called(node)} {_IN_FRAME}")
        weights: dict[int, float] = {}
        for row, words in card.rows("nodes", 1):
            nodes = self._of.node_numbers(words[0], card, row)
            if card.kind == "KINEMATICCOUPLING":
                dofs = set(card.freedoms(words[1:], row)) if any(words[1:]) else {1, 2, 3}
                self._equations.couple(node, np.unique(nodes), dofs)
                continue
            weight = card.number(words[1], row) if len(words) > 1 else 0.0
            for one in map(int, nodes):
                weights[one] = weights.get(one, 0.0) + weight
        if weights:
            self._equations.mean(node, weights, card)

    def _is_held(self, node: int) -> bool:
        """Whether a *BOUNDARY card names a node."""
        cards = [*self._of.model, *(card for step in self._of.steps for card in step.cards)]
        lines = ((card, row, words[0]) for card in cards if card.kind == "BOUNDARY" for row, words in card.rows())
        return any(node in self._of.node_numbers(word, card, row) for card, row, word in lines)

    def _areas_on(self, coupling: Card) -> dict[int, float]:
        """The nodes of the surface of a coupling, with their shares of its area: of quadratic triangles the middles of
        edges have it."""
        surface = self._of.deck.surfaces[key_of(coupling.needs("SURFACE"))]
        if surface.nodes:
            return dict.fromkeys(map(int, self._of.deck.node_sets.members(surface.name)), 1.0)
        found: dict[int, float] = {}
        for nodes, corners, places in self._sides_on(coupling):
            x = self._of.deck.points[self._of.deck.places(nodes[:, corners])]
            area = np.linalg.norm(np.cross(x[:, 2] - x[:, 0], x[:, -1] - x[:, 1]), axis=1) / 2.0
            for mine, size in zip(nodes[:, places], area / len(places), strict=True):
                for node in map(int, mine):
                    found[node] = found.get(node, 0.0) + float(size)
        return found

    def _nodes_on(self, coupling: Card) -> IntArray:
        """The nodes of the surface of a coupling; ValueError where sides get nodes that the deck has not."""
        surface = self._of.deck.surfaces[key_of(coupling.needs("SURFACE"))]
        if surface.nodes:
            return self._of.deck.node_sets.members(surface.name)
        every = ((nodes[:, corners], nodes[:, places]) for nodes, corners, places in self._sides_on(coupling))
        return np.unique(np.concatenate([part.ravel() for parts in every for part in parts]))

    def _sides_on(self, coupling: Card) -> Iterator[tuple[IntArray, list[int], list[int]]]:
        """Nodes of elements with a side on the surface of a coupling, where the corners of that are, and its middles of
        edges where it has these, else the corners again."""
        for what, side in self._of.deck.surfaces[key_of(coupling.needs("SURFACE"))].lines:
            for nodes, table in named_sides(self._of.deck, self._of.deck.solids, what, side):
                if not (side and table) or nodes.shape[1] > 10:
                    raise coupling.fault(
                        "couplings of some directions, and held distributing ones, are read on sides of elements "
                        "without midside nodes, and of 10-node tetrahedra"
                    )
                ends = EDGES[4] if nodes.shape[1] == 10 else ()
                middles = [4 + k for k, edge in enumerate(ends) if set(edge) <= set(table[0])]
                yield nodes, table[0], middles or table[0]

    def _rigid_body(self, card: Card) -> None:
        name = next(filter(None, map(card.get, ("NSET", "TIENSET", "PINNSET"))), "")  # solids have no rotations
        if not any(map(card.get, ("NSET", "TIENSET", "PINNSET", "ELSET", "ANALYTICALSURFACE"))):
            raise card.fault("needs an NSET, the ELSET of a body, or an ANALYTICAL SURFACE")
        skin = skin_of(self._of.deck, card)
        if skin is not None:
            face = self._of.face(skin.name, card)
        else:
            nodes = self._of.node_numbers(name, card, None)
            face = f"{self._of.body_of(self._of.elements_at(nodes), '*RIGID BODY')}{name}"
        point = [0.0, 0.0, 0.0]
        if card.get("REFNODE"):
            node = self._reference(card, "REFNODE")
            self._of_node[node], point = ("rigid", len(self._rigid)), self._point(node)
        if card.get("ROTNODE"):
            self._of_node[self._reference(card, "ROTNODE")] = ("rotation", len(self._rigid))
        self._rigid.append({"face": face, "point": point})

    def _bolt(self, card: Card) -> None:
        node = self._reference(card, "NODE")
        self._of_node[node] = ("bolt", len(self._bolts))
        name = card.needs("SURFACE")
        face = self._of.face(name, card)
        bolt: dict[str, Any] = {"face": face}
        if card.lines:  # reversed it presses
            vector = card.vector(0)
            bolt["direction"] = vector.tolist()
            bolt["sign"] = 1.0 if vector @ self._outwards(name, card) > 0.0 else -1.0
        self._bolts.append(bolt)
        self.cuts.append(face)

    def _outwards(self, name: str, card: Card) -> FloatArray:
        """A vector from the middle of the elements of a surface to the middle of their sides there."""
        deck, total = self._of.deck, np.zeros(3)
        for what, side in deck.surfaces[key_of(name)].lines:
            for nodes, table in named_sides(deck, deck.solids, what, side):
                if not (side and table):
                    raise card.fault(f"the surface {name!r} has no sides of elements")
                x = deck.points[deck.places(nodes)]
                total += (x[:, table[0]].mean(axis=1) - x.mean(axis=1)).sum(axis=0)
        return total

    # --- what is prescribed at reference nodes ------------------------------------------------------------------------

    def begin(self, step: Step) -> None:
        """The cards of a step follow; supports of the model belong to the first."""
        self._loads.begin(step)
        if step.begin > 0.0:
            self._held.begin(step)

    def forget(self) -> None:
        """OP=NEW in the first step: no support of the model counts."""
        self._held = Tracks[_AtReference](support=True)

    def drop(self, kind: str, step: Step) -> None:
        """OP=NEW of a kind of card: what the step has not given goes."""
        tracks = self._loads if kind == "CLOAD" else self._held
        tracks.drop(tracks.given, step)

    def support(self, node: int, card: Card, row: int, step: Step) -> bool:
        """A *BOUNDARY line at a node of no solid element; whether it is a reference node."""
        if node not in self._of_node:
            return False
        kind, number = self._of_node[node]
        words = card.words(row)
        name = key_of(words[1])
        if name in ("ENCASTRE", "PINNED"):
            dofs, value = range(1, 7 if name == "ENCASTRE" else 4), 0.0
        else:
            dofs, value = card.freedoms(words[1:], row), card.number(words[3], row) if len(words) > 3 else 0.0
        whole = value == 0.0 and dofs in (range(1, 4), range(4, 7), range(1, 7))
        if kind != "equation" and node in self._of.frames and not whole:
            raise card.fault(f"node {words[0]} {_IN_FRAME}", row)
        turns = kind == "equation" and max(dofs) > 3 and abs(value) > _SMALL_TURN
        if turns and "NLGEOM" in step.card.parameters and step.card.key("NLGEOM") != "NO":
            raise card.fault(
                f"node {words[0]} turns by {value:g} rad with NLGEOM, but a coupling of some directions takes "
                "rotations as small: let its *KINEMATIC be of 1 to 3",
                row,
            )
        for dof in dofs:
            if "FIXED" in card.parameters and kind != "bolt":
                raise card.fault("FIXED is read at nodes of solids and of bolts", row)
            if "FIXED" in card.parameters:
                self._bolts[number].setdefault("lock", step.begin)
            else:
                self._held.give((kind, number, dof), value, step, self._of.amplitude(card), step.begin == 0.0)
        return True

    def load(self, node: int, dof: int, value: float, card: Card, row: int, step: Step) -> bool:
        """A *CLOAD line at a node of no solid element; whether it is a reference node."""
        if node not in self._of_node:
            return False
        kind, number = self._of_node[node]
        if kind != "equation" and node in self._of.frames:
            raise card.fault(f"node {card.words(row)[0]} {_IN_FRAME}", row)
        self._loads.give((kind, number, dof), value, step, self._of.amplitude(card))
        return True

    def tables(self) -> dict[str, list[dict[str, Any]]]:
        """The tables of ties, rigid faces and bolts, and of the loads at reference points."""
        tables: dict[str, list[dict[str, Any]]] = {}
        for rigid in self._rigid:
            if not rigid.get("spread"):
                tables.setdefault("rigid_face", []).append({"face": rigid["face"], "point": rigid["point"]})
        self._prescribed(tables)
        self._point_loads(tables)
        for number, bolt in enumerate(self._bolts):
            tables.setdefault("pretension", []).append(self._tightened(number, dict(bolt)))
        ties = tied_pairs(self._of)
        for card in self._of.model:
            if card.kind == "TIE":
                if "MULTISTAGE" in card.parameters:
                    raise card.fault("ties of several stages are not read")
                sector = self._sector(card) if "CYCLICSYMMETRY" in card.parameters else {}
                bound = card.get("POSITIONTOLERANCE") or "2.5 % of an element"
                self._of.notes.append(
                    f"line {card.line}: tied is what is opposite to the other face, across gaps as well; CalculiX "
                    f"leaves nodes free beyond its POSITION TOLERANCE, {bound}"
                )
                for row, words in card.rows("a slave and a master surface", 2):
                    slave, master = (self._of.face(word, card, row) for word in words[:2])
                    pair = {"face": slave, "against": master, "slave": True} | sector
                    tables.setdefault("cyclic_symmetry" if sector else "tie", []).append(pair)
        if ties:
            tables.setdefault("tie", []).extend(ties)
        held = {(node, dof): track.fixed()[0] for (kind, node, dof), track in self._held.all if kind == "equation"}
        loads: dict[tuple[int, int], list[Rows]] = {}
        for (kind, node, dof), track in self._loads.all:
            if kind == "equation":
                loads.setdefault((node, dof), []).append(track.fixed()[0])
        return tables | self._equations.tables(held, loads)

    def _sector(self, tie: Card) -> dict[str, Any]:
        """The axis and the number of sectors of a *TIE, CYCLIC SYMMETRY."""
        models = [card for card in self._of.model if card.kind == "CYCLICSYMMETRYMODEL"]
        sectors = [card for card in models if card.key("TIE") in ("", tie.key("NAME"))]
        if not sectors:
            raise tie.fault("there is no *CYCLIC SYMMETRY MODEL with N and the axis")
        a, b = np.split(sectors[0].vector(0, 6), 2)
        count = int(sectors[0].setting("N"))
        if count < 2:
            raise sectors[0].fault("needs N, the number of sectors")
        return {"point": a.tolist(), "axis": (b - a).tolist(), "sectors": count}

    def _prescribed(self, tables: dict[str, list[dict[str, Any]]]) -> None:
        """Put prescribed motions into the rigid faces."""
        names = [index for index, rigid in enumerate(self._rigid) if not rigid.get("spread")]
        for key, track in self._held.all:
            kind, number, dof = key
            if track.begin is not None or track.end is not None:
                held = f"from time {track.begin:g} on, but not before" if track.end is None else f"until {track.end:g}"
                raise ValueError(
                    f"{self._of.deck.path}: *BOUNDARY: degree of freedom {dof} of a reference node is held {held}: "
                    "hold it in all steps, or put the support on nodes"
                )
            if kind == "equation":
                continue
            if kind == "bolt":
                self._bolts[number]["shortening"] = track.fixed()[0]
                continue
            table = tables["rigid_face"][names.index(number)]
            what, axis = "rotation" if kind == "rotation" or dof > 3 else "translation", "xyz"[(dof - 1) % 3]
            value, timed = self._of.course(track.fixed()[0], f"{what}_{axis}_amplitude")
            table.setdefault(what, {})[axis] = value
            table |= timed

    def _point_loads(self, tables: dict[str, list[dict[str, Any]]]) -> None:
        by_rows: dict[tuple[int, Any], dict[str, Any]] = {}
        for key, track in self._loads.all:
            kind, number, dof = key
            rows = track.fixed()[0]
            if kind == "equation":
                continue
            if kind == "bolt":
                self._bolts[number]["force"] = rows
                continue
            value, timed = self._of.course(rows)
            if value == 0.0:
                continue
            rigid = self._rigid[number]
            table = by_rows.setdefault((number, str(timed)), {"face": rigid["face"], "point": rigid["point"]})
            moment = kind == "rotation" or dof > 3
            table.setdefault("moment" if moment else "force", [0.0, 0.0, 0.0])[(dof - 1) % 3] = value
            table |= timed
        if by_rows:
            tables["point_load"] = list(by_rows.values())

    def _tightened(self, number: int, bolt: dict[str, Any]) -> dict[str, Any]:
        sign = bolt.pop("sign", 1.0)
        for name in ("force", "shortening"):
            if name in bolt:
                rows: Rows = tuple((time, sign * value) for time, value in bolt.pop(name))
                lock = bolt.get("lock")
                if lock is not None:
                    rows = tuple(row for row in rows if row[0] <= lock) or rows[:1]
                return self._of.timed(bolt, name, rows)
        raise ValueError(
            f"{self._of.deck.path}: *PRE-TENSION SECTION on {bolt['face']!r} has neither force nor shortening"
        )
