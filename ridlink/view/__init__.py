"""The live page: shows present or recorded traffic in a browser.

scenery         the source, and facts about it that are not in the traffic (goals, obstacles)
instants        every tenth of a second as a compact array; a bounded history of them
wire            instants as the JSON text that the page reads
book            the whole history under one definition: encounters, and the tightest pair of each time
velocity_space  the velocities that the selected vehicle may fly, from the solver
kernels         loads the solver's kernels while pages are served
show            one source, and answers to all requests about it; no clock, no socket
conversation    requests of one page, and the next message to it
guard           decides which requests are answered
door            limits the connections and their share of the loop's time
files           the files of the page, read once
server          serves pages on a socket
live, recorded  fill the history from a link, from a file

The protocol is in docs/view.md.
"""
