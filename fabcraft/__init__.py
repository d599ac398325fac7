"""fabcraft: from a drawing and a body to a wearable that a printer prints.  Millimetres, Z up, right-handed."""

__version__ = "0.1.0"
