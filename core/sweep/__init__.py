"""Tables of variants: devices, materials, skins, methods, seeds over scenes, a job a row, resumed where they stood."""
