"""The robot app for minutes at real time: does it keep its schedule, its memory and its share of the processor?"""
