"""Every object of a scene, without a click."""
