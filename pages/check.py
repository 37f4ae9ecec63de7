"""Check: has a camera moved since the parameters were found?"""

from stereocal.ui.menu import page_head

page_head("Check", "Has a camera moved?")

from stereocal.ui.check import show_page
from stereocal.ui.prerequisites import project_or_begin

needs = "the parameters of the rig, and a few new bars or matched points"
show_page(project_or_begin(needs, "check_begin"))
