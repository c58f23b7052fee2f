"""Components to superelements, and superelements coupled at joints to one second-order system.
Never scene files, stages or stores.
"""
