"""Contact of fingers with objects, in the order of the data.

Both ways begin with surfaces: `surfaces` after an object's scale, `deforming_surfaces` from sample to sample.

The pads' centres, for devices that need no more:
    search_radius    how near a surface must be to be measured
    stretch_rates    how fast a changing scale carries a surface along
    pad_sampler      chunks of poses -> gaps of all pads and bodies
    pair_record      one pad and one body meanwhile
    pad_contact      which fingers touch which bodies, with gaps and points, over the range
    encounter        one pad on one body at a device's rate: onsets, velocities
    holding_times    when a finger holds a body

The whole skin:
    posed_body       one body at a sample
    posed_scene      fingers and bodies at a sample, for all steppers
    sample_window    consecutive samples after the broad phase
    compliant_bone   the path solver behind a touch depth
    skin_stepper     one finger, one sample further; used by bake and preview
    held_body        one body while fingers hold it: when, how heavy, how accelerated
    held_bodies      all of them, balanced with the fingers' contacts
    skin_sampler     chunks of poses -> forces on the skins
    skin_record      one finger meanwhile
    skin_contact     the touch on a skin, at a sample and over the range
    packed_forces    its forces in a tenth of the memory, for bakes that are kept
    resultants       total forces of a contact, as series and CSV

`solver/` knows no scene: a compliance and gaps -> forces, along a path or around a grip.
"""
