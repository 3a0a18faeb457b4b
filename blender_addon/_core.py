"""The engine, as the only module that knows where it is installed.

`core.matching.pins` loads that module at its first use, so that registering the add-on stays fast. The types that mypy
sees are the engine's own.
"""

from typing import TYPE_CHECKING

PACKAGE: str = __package__  # name of the add-on; in an installed extension it has three parts, and no other is valid

if TYPE_CHECKING:
    import core.cache
    import core.command_line.arguments
    import core.command_line.messages
    import core.command_line.thimble
    import core.contact.posed_scene
    import core.contact.resultants
    import core.contact.trusted
    import core.contact.skin_contact
    import core.contact.skin_stepper
    import core.contact.solver.cone
    import core.comparison.migration
    import core.comparison.told_apart
    import core.comparison.trust_band
    import core.design.collect
    import core.design.coupled_preset
    import core.design.follow
    import core.design.interactions
    import core.design.picture
    import core.design.recordings
    import core.design.task
    import core.devices.calibration
    import core.devices.frequency_response
    import core.devices.response
    import core.devices.response_readings
    import core.devices.coupling
    import core.devices.kinds
    import core.devices.inverse_kinematics
    import core.devices.linkage
    import core.devices.pin_array
    import core.devices.workspace
    import core.devices.safe_state
    import core.devices.servo_limits
    import core.devices.shear_tactor
    import core.devices.spec
    import core.devices.thimble
    import core.effects.depth_map
    import core.effects.map_repair
    import core.effects.transient
    import core.files
    import core.foreign
    import core.images
    import core.kernels
    import core.matching
    import core.matching.adapt
    import core.matching.deformation
    import core.matching.floor
    import core.matching.lookup
    import core.matching.pin_report
    import core.matching.pins
    import core.matching.platforms
    import core.matching.press_test
    import core.matching.replay
    import core.matching.stimulus_plot
    import core.matching.table
    import core.matching.thimble
    import core.matching.thimble_job
    import core.matching.thimble_use
    import core.motion.recorded_poses
    import core.number_rows
    import core.npz
    import core.pipeline.bake
    import core.own_presets
    import core.parameters.device
    import core.parameters.error_bands
    import core.parameters.finger
    import core.parameters.material
    import core.parameters.parameter
    import core.parameters.screen
    import core.parameters.skin
    import core.parameters.stream
    import core.parameters.wave
    import core.pipeline.inputs
    import core.pipeline.kept_shares
    import core.pipeline.outputs
    import core.pipeline.render
    import core.pipeline.skipping
    import core.pipeline.trail
    import core.plot.stimuli
    import core.presets
    import core.recent
    import core.scene.content_hash
    import core.scene.scene_file
    import core.scene.sliding
    import core.scene.tactile_scene
    import core.skin.blas
    import core.skin.finger_skin
    import core.skin.model
    import core.skin.observation
    import core.skin.own_mesh
    import core.skin.recovery
    import core.skin.shape
    import core.skin.stimulus
    import core.skin.store
    import core.skin.surface_compliance
    import core.skin.surface_store
    import core.skin.stress_table
    import core.steps
    import core.stream.client
    import core.stream.links.serial_port
    import core.stream.links.url
    import core.stream.pair_command
    import core.stream.protocols.adapters
    import core.stream.protocols.pairs
    import core.stream.protocols.wire
    import core.stream.state
    import core.surface.curved
    import core.surrogate.store
    import core.track.binary
    import core.track.check
    import core.track.command_track
    import core.track.export
    import core.track.formats
    import core.track.file_names
    import core.work.executor
    import core.work.processes
    from core.arrays import Array, Floats32, Indices, Indices32
    from core.errors import DermisError, Finding, worst
else:
    from importlib import import_module
    from types import ModuleType

    class _Package:
        """A package of the engine whose modules load at their first use."""

        def __init__(self, package: ModuleType) -> None:
            self._package = package

        def __getattr__(self, name: str) -> object:
            try:
                value = getattr(self._package, name)
            except AttributeError:
                value = import_module(f"{self._package.__name__}.{name}")
            if not isinstance(value, ModuleType):
                return value  # not kept, so that replacements in the engine hold here
            made = self.__dict__[name] = _Package(value) if hasattr(value, "__path__") else value
            return made

    # an installed extension holds the engine inside; a source checkout beside it
    core = _Package(import_module(".core", PACKAGE) if PACKAGE.startswith("bl_ext.") else import_module("core"))
    DermisError, Finding, worst = core.DermisError, core.Finding, core.worst

    def __getattr__(name: str) -> object:
        if name in ("Array", "Floats32", "Indices", "Indices32"):
            return getattr(core.arrays, name)
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
