"""From predicted directions to what an antenna's axes do: commands, keyholes, search after a loss.

`interpolation` fills predictions up to the rate of the commands; `mounts` turns directions into
axis angles; `planning` chooses, for a whole pass, turn, flip and pre-slew; `commands` follows them
within the axes' limits, sample by sample; `search` and `reacquisition` say where to look after a
loss and how long it takes; `pass_log` and `replay` keep a pass and score trackers on it; `stage`
follows the passes of a mission with several mounts, planned and naive (`following`).
"""
