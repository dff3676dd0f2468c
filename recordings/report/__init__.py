"""A recording as a person looks at it: one page that needs no network, or figures for print.

story      what is read of a recording, once
figures    what is drawn of it, in which order: neither plotly nor matplotlib is known there
page       draws it in a browser; `serving` does so while the run goes on
printing   draws it on paper
"""
