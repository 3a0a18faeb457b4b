"""Which preset, skin and table an item of the scene uses, prepared for the engine."""
