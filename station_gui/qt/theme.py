"""The look of the window: one palette, one style sheet."""

from __future__ import annotations

from string import Template
from typing import Final

from PySide6.QtGui import QColor, QFont, QPalette
from PySide6.QtWidgets import QApplication

BACKGROUND: Final = "#12161c"
PANEL: Final = "#1a2029"
RAISED: Final = "#252d39"
BORDER: Final = "#2f3947"
TEXT: Final = "#e8ecf2"
MUTED: Final = "#94a1b3"
DISABLED: Final = "#5b6675"
ACCENT: Final = "#4c9ffe"
GOOD: Final = "#35c46f"
WARNING: Final = "#f0b034"
BAD: Final = "#ef4b50"
EMERGENCY: Final = "#d62b32"

# The map keeps the colours of paper 1, figures 7, 12 and 15.
MAP_FREE: Final = "#ffffff"
MAP_UNKNOWN: Final = "#9aa0a8"
MAP_OCCUPIED: Final = "#14171c"
OBJECT_LARGE: Final = "#e02929"
OBJECT_SMALL: Final = "#2257e6"
ROBOT: Final = "#1fae4b"
TRAJECTORY: Final = "#d97706"
CLOSURE: Final = "#a335d6"
SCAN: Final = "#e0357f"
PATH: Final = "#0a9c94"
GOAL: Final = "#0a9c94"
SCENE_SKY: Final = "#1d2430"

SPACING_PX: Final = 8
MARGIN_PX: Final = 10

_STYLE: Final = Template("""
* { outline: none; }
QMainWindow, QDialog { background: $BACKGROUND; }
QToolTip { background: $RAISED; color: $TEXT; border: 1px solid $BORDER; padding: 4px; }
QLabel { color: $TEXT; background: transparent; }
QLabel[role="muted"] { color: $MUTED; }
QLabel[role="title"] { color: $MUTED; font-weight: bold; letter-spacing: 1px; }
QLabel[role="sentence"] { font-size: 15px; }
QLabel[role="overlay"] { background: $PANEL; border: 1px solid $BORDER; border-radius: 6px; padding: 10px 18px;
    font-size: 14px; }
QLabel[tone="good"] { color: $GOOD; }
QLabel[tone="warning"] { color: $WARNING; }
QLabel[tone="bad"] { color: $BAD; }
QFrame[role="panel"] { background: $PANEL; border: 1px solid $BORDER; border-radius: 6px; }
QSplitter::handle { background: $BACKGROUND; }

QLabel[role="step"] { color: $DISABLED; background: $BACKGROUND; border: 1px solid $BORDER; border-radius: 4px;
    padding: 6px 12px; font-weight: bold; }
QLabel[role="step"][active="idle"] { color: $TEXT; background: $RAISED; border-color: $MUTED; }
QLabel[role="step"][active="observe"] { color: #06131f; background: $ACCENT; border-color: $ACCENT; }
QLabel[role="step"][active="command"] { color: #06170d; background: $GOOD; border-color: $GOOD; }
QLabel[role="step"][active="return"] { color: #06131f; background: $ACCENT; border-color: $ACCENT; }
QLabel[role="step"][active="paused"] { color: #1c1303; background: $WARNING; border-color: $WARNING; }
QLabel[role="step"][active="halted"] { color: #ffffff; background: $EMERGENCY; border-color: $EMERGENCY; }

QPushButton, QToolButton { color: $TEXT; background: $RAISED; border: 1px solid $BORDER; border-radius: 4px;
    padding: 6px 10px; }
QPushButton { min-height: 20px; }
QToolButton { padding: 3px 9px; }
QPushButton:hover, QToolButton:hover { border-color: $ACCENT; }
QPushButton:focus, QToolButton:focus { border-color: $ACCENT; }
QPushButton:pressed, QToolButton:pressed { background: $BORDER; }
QPushButton:checked, QToolButton:checked { background: $ACCENT; border-color: $ACCENT; color: #06131f; }
QPushButton:disabled, QToolButton:disabled { color: $DISABLED; background: $PANEL; border-color: $BORDER; }
QPushButton:checked:disabled { color: $TEXT; background: $BORDER; border-color: $MUTED; }
QPushButton[role="primary"]:enabled { background: #1f5fae; border-color: #2a74cf; font-weight: bold; }
QPushButton[role="primary"]:hover { background: #2a74cf; }
QPushButton[role="stop"]:enabled { border-color: $WARNING; color: $WARNING; font-weight: bold; }
QPushButton[role="stop"]:hover { background: $BORDER; }
QPushButton[role="emergency"] { background: $EMERGENCY; border: 2px solid #ff7b7f; border-radius: 6px; color: white;
    font-size: 17px; font-weight: bold; letter-spacing: 1px; padding: 6px 22px; }
QPushButton[role="emergency"]:hover { background: #ee3a41; border-color: white; }
QPushButton[role="emergency"]:pressed { background: #9d1b21; }
QPushButton[role="emergency"]:disabled { background: #46262b; border-color: #5c3237; color: #a98184; }

QLineEdit { color: $TEXT; background: $BACKGROUND; border: 1px solid $BORDER; border-radius: 4px; padding: 5px 7px;
    selection-background-color: $ACCENT; }
QLineEdit:focus { border-color: $ACCENT; }
QLineEdit:disabled { color: $MUTED; background: $PANEL; }
QCheckBox { color: $TEXT; spacing: 5px; background: transparent; }
QCheckBox::indicator { width: 13px; height: 13px; border: 1px solid $MUTED; border-radius: 3px;
    background: $BACKGROUND; }
QCheckBox::indicator:checked { background: $ACCENT; border-color: $ACCENT; }
QSlider { background: transparent; }
QSlider::groove:horizontal { height: 4px; background: $BORDER; border-radius: 2px; }
QSlider::sub-page:horizontal { background: $ACCENT; border-radius: 2px; }
QSlider::handle:horizontal { width: 14px; margin: -5px 0; border-radius: 7px; background: $TEXT; }
QSlider::sub-page:horizontal:disabled { background: $BORDER; }
QSlider::handle:horizontal:disabled { background: $DISABLED; }
QListView { color: $TEXT; background: $PANEL; border: none; }
QStatusBar { color: $MUTED; background: $PANEL; border-top: 1px solid $BORDER; }
QStatusBar::item { border: none; }
QStatusBar QLabel { color: $MUTED; padding: 0 8px; }
QScrollBar:vertical { background: $PANEL; width: 10px; margin: 0; }
QScrollBar::handle:vertical { background: $BORDER; border-radius: 5px; min-height: 24px; }
QScrollBar::add-line, QScrollBar::sub-line { height: 0; width: 0; }
QScrollBar:horizontal { height: 0; }
""")


def style_sheet() -> str:
    colours = {name: value for name, value in globals().items() if name.isupper() and isinstance(value, str)}
    return _STYLE.substitute(colours)


def apply_theme(application: QApplication) -> None:
    """Give `application` the palette, font and style sheet of this product."""
    application.setStyle("Fusion")
    application.setPalette(_palette())
    font = QFont(application.font())
    font.setPixelSize(13)
    application.setFont(font)
    application.setStyleSheet(style_sheet())


def _palette() -> QPalette:
    palette = QPalette()
    role = QPalette.ColorRole
    for name, colour in (
        (role.Window, BACKGROUND),
        (role.WindowText, TEXT),
        (role.Base, PANEL),
        (role.AlternateBase, RAISED),
        (role.Text, TEXT),
        (role.Button, RAISED),
        (role.ButtonText, TEXT),
        (role.ToolTipBase, RAISED),
        (role.ToolTipText, TEXT),
        (role.Highlight, ACCENT),
        (role.HighlightedText, BACKGROUND),
        (role.PlaceholderText, DISABLED),
    ):
        palette.setColor(name, QColor(colour))
    return palette
