"""Wrong gaps and interferences of a contact, for `wrong_inputs`."""

from wrong_input import Wrong, run

GAPS = [
    Wrong(
        "a gap that is no length",
        run("contact.gap=[0,0,1e-3]"),
        r"contact\.gap = \[0, 0, 0\.001\]: should be a number or an expression in quotation marks",
    ),
    Wrong(
        "an interference under that name",
        run("contact.interference=1e-5"),
        r"contact\.interference = 1e-05: there is no such key; did you mean gap, negative for an interference\?",
    ),
    Wrong(
        "an interference in millimetres",
        run("contact.gap=-20"),
        r"contact face 'bottom': gap: an interference of 20 m is larger than the body, whose extent is .* in metres",
    ),
    Wrong(
        "a gap of a file that is not there",
        run('contact.gap={file="worn.vtu", field="depth"}'),
        r"worn\.vtu: cannot be read",
    ),
    Wrong(
        "a file of gaps without a field",
        run('contact.gap={file="worn.vtu"}'),
        r"contact\.gap\.field: is missing",
    ),
    Wrong(
        "a gap that is not finite somewhere",
        run('contact.gap="1e-3/(3 - x)"'),
        r"contact face 'bottom': gap: the expression '1e-3/\(3 - x\)' is inf at \(3, 0, 0\)",
    ),
    Wrong(
        "an amplitude of a gap, without load steps",
        run("contact.gap=-1e-6", "contact.gap_amplitude=[[0,0],[1,1]]"),
        r"contact\.gap_amplitude depends on time: it needs a \[history\]",
    ),
    Wrong(
        "an amplitude without a gap",
        run("contact.gap_amplitude=[[0,0],[1,1]]"),
        r"gap_amplitude is a factor of gap, which is not given",
    ),
]
