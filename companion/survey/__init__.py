"""Stems measured on the vehicle: rays at tracked trunks are pooled as they come (`rays`, `ground`), a circle is fitted
to them once a trunk has been passed (`stem_fit`), graded (`grading`), brought to breast height (`taper`) and told as a
record (`observation`, and `track` for the area seen). `surveyor` is one vehicle's; numpy is imported by `stem_fit`
alone.
"""
