"""One component to one superelement: elastic, rigid, segmented. Never joints or poses."""
