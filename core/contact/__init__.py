"""Contact of fingers with objects; the modules in the order of the data.

Surfaces of objects: `surfaces` (after an object's scale), `deforming_surfaces` (one for each sample).

Contact of the pads' centres, for devices that need no more:
    search_radius    distance within which gaps are measured
    stretch_rates    velocity of surfaces whose scale changes
    pad_sampler      chunks of poses -> gaps between all pads and bodies
    pair_record      gaps of one pad and one body during a sweep
    pad_contact      gaps and closest points of all pairs over the whole range
    encounter        contact of one pad with one body at a device's rate: onsets, velocities
    closest_approach a finding where nothing is touched in the whole range
    holding_times    times at which a finger holds a body

Contact of the whole skin:
    posed_body       one body at a sample
    posed_scene      fingers and bodies at a sample
    sample_window    consecutive samples after the broad phase
    proximity        lower bounds of gaps, by which distant bodies are skipped
    compliant_bone   path solver with a compliant bone
    skin_stepper     one finger, one sample after the other; for bakes and previews
    doubtful_touches touches of sharp places and of bodies in one place
    held_body        one body while fingers hold it: times, mass, acceleration
    held_bodies      all held bodies, balanced with the fingers' contacts
    skin_sampler     chunks of poses -> forces on the skins
    skin_record      forces on one finger during a sweep
    skin_contact     touch on a skin, at a sample and over the whole range
    packed_forces    compressed forces, for bakes that are kept
    resultants       total forces of a contact, as series and as CSV

`solver/` does not depend on scenes: it computes forces from compliance and gaps, along a path or for a grip.
"""
