"""Components to superelements, and superelements coupled at joints to one second-order system."""
