//! Rows as a Parquet file: numbers as doubles, words as text, units and provenance as metadata.

use std::io::Write;
use std::sync::Arc;

use parquet::basic::{LogicalType, Repetition, Type as Physical};
use parquet::data_type::{ByteArray, ByteArrayType, DoubleType};
use parquet::errors::ParquetError;
use parquet::file::metadata::KeyValue;
use parquet::file::properties::WriterProperties;
use parquet::file::writer::SerializedFileWriter;
use parquet::schema::types::Type;

use super::{Column, Rows, Value, finite, shortest};
use crate::provenance;
use crate::refusal::{Refusal, Result};

/// Rows of a group: few enough for the memory, enough for fast reading.
const ROWS_PER_GROUP: usize = 65_536;

/// Values of a column in an unfinished group, numbers or words, and the rows that have one.
#[derive(Default)]
struct Waiting {
    is_text: bool,
    numbers: Vec<f64>,
    words: Vec<ByteArray>,
    levels: Vec<i16>,
}

/// Writer of rows as Parquet. Missing values are null. The file's metadata has two JSON objects:
/// `units` (of columns with a unit) and `provenance`.
pub(super) struct ParquetRows<'a> {
    writer: SerializedFileWriter<&'a mut (dyn Write + Send)>,
    waiting: Vec<Waiting>,
    rows: usize,
}

impl<'a> ParquetRows<'a> {
    pub fn begin(out: &'a mut (dyn Write + Send), columns: &[Column]) -> Result<Self> {
        let field = |column: &Column| {
            let (physical, logical) = match column.text {
                true => (Physical::BYTE_ARRAY, Some(LogicalType::String)),
                false => (Physical::DOUBLE, None),
            };
            Type::primitive_type_builder(column.name, physical)
                .with_logical_type(logical)
                .with_repetition(Repetition::OPTIONAL)
                .build()
                .map(Arc::new)
        };
        let fields = columns.iter().map(field).collect::<Result<_, _>>();
        let fields = fields.map_err(write_refusal)?;
        let schema = Type::group_type_builder("kband").with_fields(fields);
        let schema = schema.build().map_err(write_refusal)?;
        let units = super::units(columns);
        let provenance_json = provenance::object(units.clone()).to_string();
        let units = serde_json::Value::Object(units).to_string();
        let properties = WriterProperties::builder()
            .set_created_by(concat!("kband version ", env!("CARGO_PKG_VERSION")).into())
            .set_key_value_metadata(Some(vec![
                KeyValue::new("units".into(), units),
                KeyValue::new("provenance".into(), provenance_json),
            ]))
            .build();
        let waiting = columns.iter().map(|column| Waiting {
            is_text: column.text,
            ..Waiting::default()
        });
        let writer = SerializedFileWriter::new(out, Arc::new(schema), Arc::new(properties));
        Ok(Self {
            writer: writer.map_err(write_refusal)?,
            waiting: waiting.collect(),
            rows: 0,
        })
    }

    fn write_group(&mut self) -> Result<(), ParquetError> {
        if self.rows == 0 {
            return Ok(());
        }
        self.rows = 0;
        let mut group = self.writer.next_row_group()?;
        for waiting in &mut self.waiting {
            let Some(mut column) = group.next_column()? else {
                break;
            };
            let levels = Some(&waiting.levels[..]);
            if waiting.is_text {
                let typed = column.typed::<ByteArrayType>();
                typed.write_batch(&waiting.words, levels, None)?;
            } else {
                let typed = column.typed::<DoubleType>();
                typed.write_batch(&waiting.numbers, levels, None)?;
            }
            waiting.numbers.clear();
            waiting.words.clear();
            waiting.levels.clear();
            column.close()?;
        }
        group.close()?;
        Ok(())
    }
}

fn write_refusal(error: ParquetError) -> Refusal {
    super::rows::write_refusal(&std::io::Error::other(error))
}

impl Rows for ParquetRows<'_> {
    fn row(&mut self, row: &[Value]) -> Result<()> {
        for (waiting, value) in self.waiting.iter_mut().zip(row) {
            let number = match value {
                _ if waiting.is_text => None,
                Value::Number(number) => finite(*number),
                Value::Single(number) => finite(shortest(*number)),
                Value::Count(count) => Some(*count as f64),
                Value::Flag(flag) => Some(f64::from(u8::from(*flag))),
                Value::Text(_) | Value::Missing => None,
            };
            let has_word = waiting.is_text && *value != Value::Missing;
            let word = has_word.then(|| ByteArray::from(value.read(17).into_bytes()));
            let is_given = number.is_some() || word.is_some();
            waiting.levels.push(i16::from(is_given));
            waiting.numbers.extend(number);
            waiting.words.extend(word);
        }
        self.rows += 1;
        if self.rows == ROWS_PER_GROUP {
            self.write_group().map_err(write_refusal)?;
        }
        Ok(())
    }

    fn end(&mut self) -> Result<()> {
        self.write_group().map_err(write_refusal)?;
        self.writer.finish().map(|_| ()).map_err(write_refusal)
    }
}

#[cfg(test)]
mod tests {
    use std::fs::File;

    use parquet::file::reader::{FileReader, SerializedFileReader};
    use parquet::record::RowAccessor;

    use super::*;

    #[test]
    fn written_rows_are_read_with_their_units() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.parquet");
        let mut file = File::create(&path).unwrap();
        let columns = [
            Column::new("time", "s"),
            Column::new("k", ""),
            Column::new("state", "").text(),
        ];
        let mut rows = ParquetRows::begin(&mut file, &columns).unwrap();
        // More rows than a group.
        let count = ROWS_PER_GROUP as u32 + 10;
        for n in 0..count {
            let k = (n % 3 != 0).then_some(0.4).into();
            let row = [(f64::from(n) * 0.02).into(), k, "locked".into()];
            rows.row(&row).unwrap();
        }
        rows.end().unwrap();
        let reader = SerializedFileReader::new(File::open(&path).unwrap()).unwrap();
        let metadata = reader.metadata().file_metadata();
        assert_eq!(metadata.num_rows(), i64::from(count));
        let pairs = metadata.key_value_metadata().unwrap();
        let find = |key: &str| pairs.iter().find(|pair| pair.key == key)?.value.as_deref();
        assert_eq!(find("units"), Some(r#"{"time":"s"}"#));
        assert!(find("provenance").unwrap().contains("\"commit\":"));
        let last = reader.get_row_iter(None).unwrap().last().unwrap().unwrap();
        assert_eq!(last.get_double(0).unwrap(), f64::from(count - 1) * 0.02);
        assert_eq!(last.get_double(1).is_ok(), !(count - 1).is_multiple_of(3));
        assert_eq!(last.get_string(2).unwrap(), "locked");
    }
}
