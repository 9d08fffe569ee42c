"""What several stages measure with: bounds, planes, nearest neighbours, connected components."""
