"""The visible surface of a scene and its regions, on which objects are selected and found."""
