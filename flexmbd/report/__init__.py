"""Reports for papers: tables, pictures and text become one page, files for a paper, and a digest.

What is measured stands elsewhere (`continuum.contract_suite`, `command`, `run`), which may import this room; it loads
numpy alone, and matplotlib when a report is written.
"""

from flexmbd.report.contents import Cell as Cell
from flexmbd.report.contents import Content as Content
from flexmbd.report.contents import Listing as Listing
from flexmbd.report.contents import Paragraph as Paragraph
from flexmbd.report.contents import Report as Report
from flexmbd.report.contents import ReportPicture as ReportPicture
from flexmbd.report.contents import ReportSection as ReportSection
from flexmbd.report.contents import ReportTable as ReportTable
from flexmbd.report.contents import number_text as number_text
from flexmbd.report.folder import PAGE as PAGE
from flexmbd.report.folder import refuse_folder as refuse_folder
from flexmbd.report.folder import write_report as write_report
from flexmbd.report.line_diagram import Line as Line
from flexmbd.report.line_diagram import diagram as diagram
from flexmbd.room import public_names as _public_names

__all__ = _public_names(globals())
