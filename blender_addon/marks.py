"""Names of custom properties by which the add-on knows what it has made. No bake depends on what has such a mark."""

FILM = "dermis_film"  # an object or a collection for films: its kind
FILM_HIDES = "dermis_hides"  # an object for films that has hidden its finger from renders
COMMANDS = "dermis_commands"  # a holder of command curves: their properties; also an action of such curves
