"""A recording as a person looks at it: one page that needs no network, or figures for print.

data        what is read of a recording, once
figures     what is drawn of it, in which order: neither plotly nor matplotlib is known there
page        draws it in a browser; `server` does so while the run goes on
print       draws it on paper
"""
