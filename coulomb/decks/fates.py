"""What becomes of the cards of a deck: used, not needed here, or refused with the line."""

from __future__ import annotations

import difflib
from collections.abc import Collection, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from .cards import Card, key_of
from .equations import LINKS
from .rigid_surfaces import RIGID
from .springs import KINDS
from .steps import PROCEDURES, STEADY

USED, NOT_NEEDED, REFUSED = "used", "not needed here", "refused"

_GEOMETRY: Final = ("NODE", "ELEMENT", "NSET", "ELSET", "SURFACE", "PART", "ENDPART", "INSTANCE", "ENDINSTANCE")

_OF_HEAT: Final = ("CONDUCTIVITY", "GAPCONDUCTANCE", "FILM", "DFLUX")

_HANDLED: Final = frozenset(
    (
        *_GEOMETRY,
        *("ASSEMBLY", "ENDASSEMBLY", "HEADING", "STEP", "ENDSTEP", "STATIC", "MATERIAL", "ELASTIC", "HYPERELASTIC"),
        *("DENSITY", "EXPANSION", "SOLIDSECTION", "ORIENTATION", "BOUNDARY", "CLOAD", "DLOAD", "DSLOAD", "AMPLITUDE"),
        *("CONTACTPAIR", "SURFACEINTERACTION", "SURFACEBEHAVIOR", "FRICTION", "CLEARANCE", "CHANGEFRICTION"),
        *("CHANGESURFACEBEHAVIOR", "CONTACTINTERFERENCE"),
        *(
            "TIE",
            "TRANSFORM",
            "EQUATION",
            "MPC",
            "RIGIDBODY",
            "COUPLING",
            "KINEMATIC",
            "DISTRIBUTING",
            "KINEMATICCOUPLING",
            "DISTRIBUTINGCOUPLING",
            "PRE-TENSIONSECTION",
        ),
        *("SPRING", "CONTACT", "CONTACTINCLUSIONS", "CONTACTPROPERTYASSIGNMENT"),
        *("TEMPERATURE", "INITIALCONDITIONS", "CYCLICSYMMETRYMODEL", *_OF_HEAT),
    )
)

_IN_STEPS: Final = frozenset(
    ("CLOAD", "DLOAD", "DSLOAD", "TEMPERATURE", "FILM", "DFLUX", "MODELCHANGE", "CHANGEFRICTION")
    + ("CHANGESURFACEBEHAVIOR", "STATIC", "CONTACTINTERFERENCE")
)

_OUTSIDE: Final = frozenset(
    ("MATERIAL", "ELASTIC", "HYPERELASTIC", "DENSITY", "EXPANSION", "SOLIDSECTION", "ORIENTATION", "TRANSFORM", "TIE")
    + ("EQUATION", "MPC", "RIGIDBODY", "COUPLING", "KINEMATIC", "DISTRIBUTING", "PRE-TENSIONSECTION", "SPRING")
    + ("KINEMATICCOUPLING", "DISTRIBUTINGCOUPLING")
    + ("CONTACTPAIR", "SURFACEINTERACTION", "CLEARANCE", "CYCLICSYMMETRYMODEL", "INITIALCONDITIONS", "GAPCONDUCTANCE")
    + ("CONTACT", "CONTACTINCLUSIONS", "CONTACTPROPERTYASSIGNMENT")
)

_WITHOUT_MEANING: Final = {
    **dict.fromkeys(("CONTROLS", "TIMEPOINTS", "NOANALYSIS", "SOLUTIONTECHNIQUE"), "increments and iterations"),
    **dict.fromkeys(("CONTACTDAMPING", "CONTACTCONTROLS", "CONTACTSTABILIZATION"), "contact is exact"),
    **dict.fromkeys(("DAMPING", "SPECIFICHEAT"), "of statics"),
    "CONTACTFORMULATION": "slaves are chosen by their meshes",
    "SURFACESMOOTHING": "faces are those of the mesh",
    "SURFACESECTION": "surface elements have no stiffness",
    **dict.fromkeys(
        ("NODEPRINT", "NODEFILE", "NODEOUTPUT", "ELPRINT", "ELFILE", "ELEMENTOUTPUT", "CONTACTPRINT", "CONTACTFILE"),
        "all results are written",
    ),
    **dict.fromkeys(
        ("CONTACTOUTPUT", "OUTPUT", "SECTIONPRINT", "ENERGYPRINT", "ENERGYOUTPUT"), "all results are written"
    ),
    **dict.fromkeys(("PREPRINT", "RESTART", "MONITOR", "FILEFORMAT", "ELEMENTPRINT"), "all results are written"),
    **dict.fromkeys(("PHYSICALCONSTANTS", "VALUESATINFINITY"), "no heat radiates"),
    **dict.fromkeys(
        ("SENSITIVITY", "DESIGNVARIABLES", "DESIGNRESPONSE", "OBJECTIVE", "FILTER"), "a step of sensitivities"
    ),
}

_OF_LOADS: Final = ("SUBMODEL", "LOADCASE", "TIMEDELAY", "SECTOR", "OMEGA0", "USER")

_NOT_READ: Final = {
    "BOUNDARY": (*_OF_LOADS, "STEP", "DATASET", "REGIONTYPE"),
    **dict.fromkeys(
        ("CLOAD", "DLOAD", "DSLOAD"), (*_OF_LOADS, "STEP", "DATASET", "FOLLOWER=YES", "REGIONTYPE", "ORIENTATION")
    ),
    **dict.fromkeys(("FILM", "DFLUX"), (*_OF_LOADS, "FILMAMPLITUDE", "REGIONTYPE")),
    **dict.fromkeys(("NODE", "ELEMENT", "NSET", "ELSET", "EQUATION", "AMPLITUDE"), ("INPUT",)),
    "TIE": ("MULTISTAGE", "TIEDNSET", "FLUIDPERIODIC", "THERMALPERIODIC"),
    "CONTACTPAIR": ("TIED",),
    "SPRING": ("ORIENTATION", "DEPENDENCIES"),
    "SOLIDSECTION": ("COMPOSITE", "NODALTHICKNESS", "DENSITY"),
    **dict.fromkeys(("ELASTIC", "EXPANSION", "DENSITY", "CONDUCTIVITY"), ("DEPENDENCIES", "USER", "MODULI")),
    "HYPERELASTIC": ("TESTDATAINPUT", "MODULI", "DEPENDENCIES", "USER"),
    "ORIENTATION": ("DEFINITION", "LOCALDIRECTIONS"),
    "RIGIDBODY": ("POSITION=CENTEROFMASS",),
}
"""Parameters that change what a card says, by its kind."""

_INSTEAD: Final = {
    **dict.fromkeys(
        ("CONTACTINITIALIZATIONDATA", "CONTACTINITIALIZATIONASSIGNMENT"),
        "give gaps and overlaps of two surfaces by *CONTACT PAIR with ADJUST, or with *CLEARANCE",
    ),
    "GAP": "in place of gap elements (GAPUNI) give a *CONTACT PAIR of the faces, with *CLEARANCE for the gap",
}
"""What to do in place of cards that are refused, by their kind."""

_PARAMETERS: Final = frozenset(
    """
    ADD ADIABATIC ADJUST ALLELEMENTBASED ALLEXTERIOR ALLSDTOL ALPHA AMPLITUDE ANALYTICALSURFACE ANISOTROPIC ARRUDA-BOYCE
    AUGMENTEDLAGRANGE BEGIN BETA BINC BSTEP CETOL CHECK CHECKSYMMETRY COMBINE COMPLEX COMPLEXSTIFFNESS COMPOSITE
    COMPRESSION CONSTANTRESULTANT CONSTRAINTNAME CONSTRAINTRATIO CONTINUE CONTROLS CONVERTSDI COUPLING CPSET CREEP CROP
    CYCLICMODE CYCLICSYMMETRY DATASET DEFINITION DELTMX DENSITY DEPENDENCIES DEPVAR DIRECT DRIVINGELSETS EINC
    ELASTICSLIP ELEMENT ELSET END ESTEP EXPLICIT EXPONENTIALDECAY EXTENSIONZONE EXTRAPOLATION FACTOR FILE FILLETRADIUS
    FILMAMPLITUDE FIXED FIXEDINTERVAL FLUIDPERIODIC FOLLOWER FREQUENCY GENERATE GEOMETRICCORRECTION GLOBALELSET HCRIT
    IMAGINARY INC INCF INFLUENCERADIUS INPUT INSTANCE INTERACTION INTERNAL INTERPOLATE ISOTHERMAL LAGRANGE LIBRARY
    LOADCASE LOCALDIRECTIONS LONGTERM MARLOW MASSFLOW MASTER MATERIAL MAXRATIO MECHANICALCONSTRAINT MIDSIDE
    MINIMUMDISTANCE MODE MODULI MOONEY-RIVLIN MOONEYRIVLIN MULTISTAGE N NAME NEOHOOKE NEO-HOOKE NGRAPH NLGEOM
    NODALTHICKNESS NODE NONLINEAR NOOFFSET NOROTATION NOSEPARATION NOSTOP NOTHICK NOTHICKNESS NSET OFFSET OGDEN OMEGA0
    OP ORDER ORIENTATION PADTHICKNESS PART PENALTY PERTURBATION PINNSET POISSON POLYNOMIAL PORTED POSITION
    POSITIONTOLERANCE PRESSURE PRESSURE-OVERCLOSURE PROPERTIES PROPERTY REAL REDUCEDPOLYNOMIAL REFNODE REGIONTYPE REMOVE
    RESET RIKS ROTNODE ROUGH RTOL SCALEFACTOR SCALETHICK SECTION SECTOR SHEARTRACTIONSLOPE SHIFTX SHIFTY SHRINK SLAVE
    SLIDINGTRANSITION SLIPTOLERANCE SMALLSLIDING SMOOTH SOLIDELEMENTNUMBERING SOLVER SRATEFACTOR STABILIZE
    STACKDIRECTION STEADYSTATE STEP SUBMODEL SUPPLEMENTARYCONSTRAINTS SURFACE SYMMETRIC SYSTEM TAUMAX TESTDATA
    TESTDATAINPUT THERMALPERIODIC THICKNESS TIE TIED TIEDNSET TIENSET TIME TIMEDELAY TIMERESET TOTALTIMEATSTART TRACKING
    TRACKINGTHICKNESS TRIM TYPE UNSORTED UNSYMM USER VALUE VANDERWAALS VARIABLE VARIABLES WEIGHT WEIGHTINGMETHOD YEOH
    ZERO
    """.split()
)
"""Of all kinds of cards that are read, by the manuals of CalculiX and Abaqus, without blanks."""

_ALIKE: Final = 0.85
"""Likeness of a parameter that there is not and one that there is, from which that is meant (difflib's ratio)."""

_GENERALISED: Final = (
    "their front may turn, as that of no slice does; where it does not, write CPE, and a case with "
    'slice = "generalised plane strain" in [mesh] and this file'
)
"""Of elements CPEG."""


@dataclass
class Row:
    """What becomes of the cards of one keyword.

    Attributes:
        keyword: As in the deck.
        fate: USED, NOT_NEEDED or REFUSED.
        why: In words; with file and line where it is refused.
    """

    keyword: str
    count: int
    fate: str
    why: str = ""


def fates(
    cards: Iterable[Card], ignore: Collection[str], surface_elements: Collection[str], sections: Collection[str] = ()
) -> list[Row]:
    """The table of cards, in the order of the deck; those to ignore by `Card.kind`; types of elements that lie on
    solids, and of those of a section in 2D and of rigid surfaces, by name."""
    rows: dict[str, Row] = {}
    cards = list(cards)
    heated = any(card.kind in STEADY for card in cards)
    for card in cards:
        fate, why = _fate(card, ignore, surface_elements, sections, heated)
        row = rows.get(card.kind)
        if row is None:
            rows[card.kind] = Row(card.keyword, 1, fate, why)
            continue
        row.count += 1
        if (fate == REFUSED and row.fate != REFUSED) or (fate == USED and row.fate == NOT_NEEDED):
            row.fate, row.why = fate, why
        elif fate == row.fate and not row.why:
            row.why = why
    return list(rows.values())


def refuse_misplaced(outside: Iterable[Card], inside: Iterable[Card]) -> None:
    """ValueError, with the line, if a card stands outside of the steps but says something of one, or the other way
    round: it would have no effect."""
    for card in outside:
        if card.kind in _IN_STEPS:
            raise card.fault("stands outside of the steps, and is read inside of them")
    for card in inside:
        if card.kind in _OUTSIDE:
            raise card.fault("stands inside of a step, and is read outside of them")


def _fate(
    card: Card, ignore: Collection[str], surface_elements: Collection[str], sections: Collection[str], heated: bool
) -> tuple[str, str]:
    kind = card.kind
    where = f"{Path(card.file).name}, line {card.line}"
    if kind in ignore:
        return NOT_NEEDED, "ignored, as asked for"
    if kind in _WITHOUT_MEANING:
        return NOT_NEEDED, _WITHOUT_MEANING[kind]
    if kind == "ELEMENT":
        title = card.get("TYPE").upper()
        if title.startswith(("C3D", "DC3D")) or title in sections:
            return USED, ""
        if title in KINDS:
            return USED, "springs"
        if title == "DCOUP3D":
            return USED, "reference nodes of *DISTRIBUTING COUPLING"
        if title in surface_elements:
            return USED, "surface elements name faces"
        if title.startswith("CPEG"):
            return REFUSED, f"{where}: elements of type {title}: {_GENERALISED}"
        if RIGID.match(title):
            return REFUSED, f"{where}: elements of type {title} of which no *RIGID BODY has the ELSET"
        return REFUSED, f"{where}: elements of type {title} are no solids"
    if kind == "STATIC" and "RIKS" in card.parameters:
        return REFUSED, f"{where}: loads are given, not found along an arc (RIKS)"
    if kind in STEADY and "STEADYSTATE" in card.parameters:
        return USED, ""
    if kind in PROCEDURES and kind != "STATIC":
        solved = "*STATIC steps, and those of temperature and displacement with STEADY STATE, are solved"
        return REFUSED, f"{where}: {solved}"
    if kind in _OF_HEAT and not heated:
        return NOT_NEEDED, "no step conducts heat"
    if kind == "INITIALCONDITIONS" and card.key("TYPE") != "TEMPERATURE":
        return REFUSED, f"{where}: of initial conditions only temperatures are read"
    if kind == "STEP" and "PERTURBATION" in card.parameters:
        return REFUSED, f"{where}: perturbations of a step before are not computed"
    if kind == "MPC" and not any(word in ("PLANE", "STRAIGHT", *LINKS) for word in map(key_of, card.words(0))):
        return REFUSED, f"{where}: of kind {card.words(0)[0]}; PLANE, STRAIGHT, {', '.join(LINKS)} are read"
    if kind == "MODELCHANGE" and not card.key("TYPE").startswith("CONTACTPAIR"):
        return REFUSED, f"{where}: elements are neither taken out nor put in"
    if kind == "BOUNDARY" and card.key("TYPE") not in ("", "DISPLACEMENT"):
        return REFUSED, f"{where}: of type {card.get('TYPE')}: displacements are read"
    for name in _NOT_READ.get(kind, ()):
        parameter, _, value = name.partition("=")
        if parameter in card.parameters and (not value or card.key(parameter) in ("", value)):
            return REFUSED, f"{where}: with {parameter} it says what is not read"
    if kind in _HANDLED or kind == "MODELCHANGE":
        unknown = [name for name in card.parameters if name not in _PARAMETERS]
        for name in unknown:
            for meant in difflib.get_close_matches(name, _PARAMETERS, 1, _ALIKE):
                return REFUSED, f"{where}: there is no parameter {name}; did you mean {meant}?"
        return USED, f"{where}: not read: {', '.join(unknown)}" if unknown else ""
    return REFUSED, f"{where}: {_INSTEAD.get(kind, 'coulomb has nothing like it')}"
