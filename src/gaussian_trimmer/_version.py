"""The version, in a module that imports nothing: what stands below the package's root can name it, too."""

__version__ = "0.1.0"
