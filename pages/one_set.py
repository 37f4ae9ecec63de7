"""One set or two: does this rig need two sets, and which input disagrees?"""

from stereocal.ui.menu import page_head

page_head("One set or two", "Does this rig need two sets, or does one set do both jobs?")

from stereocal.ui.one_set import show_page

show_page()
