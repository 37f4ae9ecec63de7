"""Help: the documentation of this version."""

from stereocal.ui.menu import page_head

page_head("Help")

from stereocal.ui.help import show_help

show_help()
