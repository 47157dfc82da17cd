"""The live page: what happens in the air, or happened, in a browser.

scenery         what a source is, and what is known beside what is heard
instants        every tenth of a second as a compact array; a bounded history of them
wire            instants as the JSON text that the page reads
book            the whole history under one definition: encounters, and which pair was tightest when
velocity_space  what the selected vehicle may fly, as its solver would see it
kernels         the solver's kernels, loaded while pages are served
show            one source and all that can be asked about it; no clock, no socket
conversation    what one page asks, and what it is answered next
guard           which requests are answered at all
files           the files of the page, read once
server          pages on a socket
live, recorded  what fills the history: a link, a file

The protocol is in docs/view.md.
"""
