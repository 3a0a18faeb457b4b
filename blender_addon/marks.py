"""Names of custom properties that mark data made by the add-on. No bake depends on marked data."""

FILM = "dermis_film"  # an object or a collection for films: its kind
FILM_HIDES = "dermis_hides"  # an object for films that has hidden its finger from renders
COMMANDS = "dermis_commands"  # a holder of command curves: their properties; also an action of such curves
