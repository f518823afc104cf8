//! Shapes as a PDF of one page; text is drawn as outlines.

use flate2::Compression;
use flate2::write::ZlibEncoder;
use pdf_writer::types::LineJoinStyle;
use pdf_writer::{Content, Filter, Finish, Name, Pdf, Ref, TextStr};

use super::shape::{Path, Raster, Shape, Text};
use super::theme::Colour;
use super::{Look, font};

const CATALOG: Ref = Ref::new(1);
const PAGES: Ref = Ref::new(2);
const PAGE: Ref = Ref::new(3);
const CONTENT: Ref = Ref::new(4);
const INFO: Ref = Ref::new(5);
/// Number of the first object for opacities; images with their masks follow.
const FIRST_OPACITY_OBJECT: i32 = 6;

pub(super) fn document(
    size: [f64; 2],
    [title, about]: [&str; 2],
    look: Look,
    shapes: &[Shape],
) -> Vec<u8> {
    let points = look.points();
    let [width, height] = size.map(|length| (length * points) as f32);
    let mut sheet = Sheet {
        content: Content::new(),
        opacities: Vec::new(),
        images: Vec::new(),
    };
    sheet.content.save_state();
    // Downwards from the upper left corner, as the shapes.
    let scale = points as f32;
    let downwards = [scale, 0.0, 0.0, -scale, 0.0, height];
    sheet.content.transform(downwards);
    sheet.content.set_line_join(LineJoinStyle::RoundJoin);
    for shape in shapes {
        sheet.draw(shape);
    }
    sheet.content.restore_state();
    let mut pdf = Pdf::new();
    pdf.catalog(CATALOG).pages(PAGES);
    pdf.pages(PAGES).kids([PAGE]).count(1);
    let mut info = pdf.document_info(INFO);
    info.title(TextStr(title)).creator(TextStr("kband"));
    if !about.is_empty() {
        info.subject(TextStr(about));
    }
    info.finish();
    let state = |n: usize| (format!("O{n}"), Ref::new(FIRST_OPACITY_OBJECT + n as i32));
    let first = FIRST_OPACITY_OBJECT + sheet.opacities.len() as i32;
    let image = |n: usize| (format!("I{n}"), Ref::new(first + 2 * n as i32));
    let mut page = pdf.page(PAGE);
    page.parent(PAGES)
        .contents(CONTENT)
        .media_box(pdf_writer::Rect::new(0.0, 0.0, width, height));
    let mut resources = page.resources();
    let mut opacities = resources.ext_g_states();
    for n in 0..sheet.opacities.len() {
        let (name, object) = state(n);
        opacities.pair(Name(name.as_bytes()), object);
    }
    opacities.finish();
    let mut images = resources.x_objects();
    for n in 0..sheet.images.len() {
        let (name, object) = image(n);
        images.pair(Name(name.as_bytes()), object);
    }
    images.finish();
    resources.finish();
    page.finish();
    for (n, opacity) in sheet.opacities.iter().enumerate() {
        pdf.ext_graphics(state(n).1)
            .non_stroking_alpha(*opacity)
            .stroking_alpha(*opacity);
    }
    for (n, raster) in sheet.images.iter().enumerate() {
        embed_image(&mut pdf, image(n).1, raster);
    }
    pdf.stream(CONTENT, &deflate(&sheet.content.finish()))
        .filter(Filter::FlateDecode);
    pdf.finish()
}

struct Sheet<'a> {
    content: Content,
    opacities: Vec<f32>,
    images: Vec<&'a Raster>,
}

impl<'a> Sheet<'a> {
    fn draw(&mut self, shape: &'a Shape) {
        match shape {
            Shape::Path(path) => {
                self.content.save_state();
                if let Some(clip) = path.clip {
                    let [left, top, width, height] = clip.sides().map(|length| length as f32);
                    self.content.rect(left, top, width, height);
                    self.content.clip_nonzero().end_path();
                }
                if let Some(fill) = path.fill {
                    self.opacity(fill.opacity);
                    let [red, green, blue] = parts(fill);
                    self.content.set_fill_rgb(red, green, blue);
                    self.outline(path);
                    self.content.fill_nonzero();
                }
                if let Some(stroke) = path.stroke {
                    self.opacity(stroke.colour.opacity);
                    let [red, green, blue] = parts(stroke.colour);
                    self.content.set_stroke_rgb(red, green, blue);
                    self.content.set_line_width(stroke.width as f32);
                    if !stroke.dash.is_empty() {
                        let dash = stroke.dash.iter().map(|length| *length as f32);
                        self.content.set_dash_pattern(dash, 0.0);
                    }
                    self.outline(path);
                    self.content.stroke();
                }
                self.content.restore_state();
            }
            Shape::Text(text) => self.draw_text(text),
            Shape::Image(place, raster) => {
                let name = format!("I{}", self.images.len());
                self.images.push(raster);
                let [left, _, width, height] = place.sides().map(|length| length as f32);
                let transform = [width, 0.0, 0.0, -height, left, place.bottom() as f32];
                self.content.save_state();
                self.content.transform(transform);
                self.content.x_object(Name(name.as_bytes()));
                self.content.restore_state();
            }
        }
    }

    fn outline(&mut self, path: &Path) {
        for piece in &path.pieces {
            for (n, (x, y)) in piece.iter().enumerate() {
                let (x, y) = (*x as f32, *y as f32);
                match n {
                    0 => self.content.move_to(x, y),
                    _ => self.content.line_to(x, y),
                };
            }
            if path.closed {
                self.content.close_path();
            }
        }
    }

    fn opacity(&mut self, opacity: f32) {
        let existing = self.opacities.iter().position(|other| *other == opacity);
        let n = existing.unwrap_or_else(|| {
            self.opacities.push(opacity);
            self.opacities.len() - 1
        });
        let name = format!("O{n}");
        self.content.set_parameters(Name(name.as_bytes()));
    }

    fn draw_text(&mut self, text: &Text) {
        let ((x, y), shift) = (text.at, text.shift());
        let place = if text.upright {
            [0.0, -1.0, 1.0, 0.0, x as f32, (y + shift) as f32]
        } else {
            [1.0, 0.0, 0.0, 1.0, (x - shift) as f32, y as f32]
        };
        self.content.save_state();
        self.opacity(text.colour.opacity);
        let [red, green, blue] = parts(text.colour);
        self.content.set_fill_rgb(red, green, blue);
        self.content.transform(place);
        let content = &mut self.content;
        font::outline(&text.content, text.size, text.bold, |begin, [b, c, d]| {
            if let Some(begin) = begin {
                content.move_to(begin.x, begin.y);
            }
            content.cubic_to(b.x, b.y, c.x, c.y, d.x, d.y);
        });
        self.content.fill_nonzero();
        self.content.restore_state();
    }
}

fn parts(colour: Colour) -> [f32; 3] {
    colour.rgb.map(|part| f32::from(part) / 255.0)
}

fn embed_image(pdf: &mut Pdf, object: Ref, raster: &Raster) {
    let (width, height) = (raster.width as i32, raster.height as i32);
    let mask = Ref::new(object.get() + 1);
    let clear = raster.palette.iter().any(|colour| colour.opacity < 1.0);
    let pixels = deflate(&raster.pixels);
    let mut image = pdf.image_xobject(object, &pixels);
    image.filter(Filter::FlateDecode);
    image.width(width).height(height).bits_per_component(8);
    let (last, rgb) = (raster.palette.len().saturating_sub(1) as i32, raster.rgb());
    let space = image.color_space();
    space.indexed(Name(b"DeviceRGB"), last, &rgb);
    if clear {
        image.s_mask(mask);
    }
    image.finish();
    if !clear {
        return;
    }
    let opacity = |number: &u8| {
        let entry = raster.palette.get(usize::from(*number));
        entry.map_or(0, |colour| (colour.opacity * 255.0).round() as u8)
    };
    let opacities: Vec<u8> = raster.pixels.iter().map(opacity).collect();
    let opacities = deflate(&opacities);
    let mut image = pdf.image_xobject(mask, &opacities);
    image.filter(Filter::FlateDecode);
    image.width(width).height(height).bits_per_component(8);
    image.color_space().device_gray();
}

fn deflate(bytes: &[u8]) -> Vec<u8> {
    use std::io::Write as _;
    let mut encoder = ZlibEncoder::new(Vec::new(), Compression::default());
    // Writing to a Vec cannot fail.
    let _ = encoder.write_all(bytes);
    encoder.finish().unwrap_or_default()
}
