"""fabcraft: from a drawing and a body to a wearable that a printer prints.  Millimetres, Z up, right-handed.

    import fabcraft

    made = fabcraft.make(fabcraft.Recipe(sketch="cat.png", body="woman", output=("cat.3mf",)))
    print(made.report.verdict)
    fabcraft.write_all(made)

Names are imported when they are first used, so that `import fabcraft` costs nothing.
"""

from importlib import import_module
from typing import Any

__version__ = "0.1.0"

_HOMES = {
    "Made": "fabcraft.pipeline",
    "find_body": "fabcraft.wearer",
    "make": "fabcraft.pipeline",
    "write_all": "fabcraft.outputs",
    "Recipe": "fabcraft.recipe",
    "read_recipe": "fabcraft.recipe",
    "Mesh": "fabcraft.mesh",
    "read_mesh": "fabcraft.read.mesh_file",
    "write_mesh": "fabcraft.write.files",
    "PrinterProfile": "fabcraft.profile",
    "list_profiles": "fabcraft.profile",
    "load_profile": "fabcraft.profile",
    "PrintReport": "fabcraft.check.report",
    "check_mesh": "fabcraft.check.inspect",
    "SolidSettings": "fabcraft.solid.thicken",
    "solidify": "fabcraft.solid.thicken",
    "FabcraftError": "fabcraft.errors",
    "InputError": "fabcraft.errors",
    "MissingError": "fabcraft.errors",
    "SolidError": "fabcraft.errors",
}
"""Where the names of the Python interface live."""

__all__ = ["__version__", *_HOMES]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'fabcraft' has no attribute {name!r}")
    value = getattr(import_module(_HOMES[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *_HOMES})
