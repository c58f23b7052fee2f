"""One component to one superelement: elastic, rigid or segmented. Never joints or poses."""
