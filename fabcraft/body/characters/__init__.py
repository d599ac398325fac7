"""The characters: modelled from simple shapes, each in a module of its own."""
