"""FMUs of our own: declared, generated, compiled; from our models or a URDF."""
