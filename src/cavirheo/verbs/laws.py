"""`cavirheo laws`: every constitutive law with its parameters."""

from __future__ import annotations


def laws() -> None:
    """All laws for `simulate --material`: parameters with units, and the energy or viscosity function."""
    from cavirheo.physics.materials import EXAMPLE, KINDS, summary, usage

    for kind, names in KINDS.items():
        print(f"{kind}:")
        for name in names:
            print(f"  {usage(name)}\n      {summary(name)}")
        print()
    print(
        "A material is one law, or a sum of one elastic part, one viscous part and any with memory:\n"
        f"  --material '{EXAMPLE}'"
    )
    print("Parameters by position or by name (shear_modulus=2e3); those with a value here (= 0) may be left out.")
