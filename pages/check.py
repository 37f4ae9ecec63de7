"""Check: has a camera moved since the parameters were found?"""

from stereocal.ui.menu import page_head

page_head("Check", "Has a camera moved?")

from stereocal.ui import check, check_rig
from stereocal.ui.prerequisites import project_or_begin

needs = "the parameters of the rig, and a few new bars or matched points"
project = project_or_begin(needs, "check_begin")
if check_rig.checks_rig(project):
    if (of_rig := check_rig.choose_inputs(project)) is not None:
        check_rig.show_check(of_rig)
elif (chosen := check.choose_inputs(project)) is not None:
    check.show_check(chosen)
