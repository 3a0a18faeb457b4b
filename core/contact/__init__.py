"""What is touched, when and how hard: gaps of pads, contact of whole skins, objects that are held."""
