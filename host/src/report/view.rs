//! A result by its fields: each has a column, the function to its value, and the formats with it.

use serde_json::Value as Json;

use super::Printout;
use super::table::{Column, Table};
use super::value::Value;

/// Formats of a result, one bit each: text table, CSV, JSON.
const READ: u8 = 1;
const CSV: u8 = 2;
const JSON: u8 = 4;

/// A field of a result `R`: its column, and the function from the result to its value.
pub struct Field<'a, R> {
    forms: u8,
    column: Column,
    value: Box<dyn Fn(&R) -> Value + 'a>,
}

impl<'a, R> Field<'a, R> {
    fn new<V: Into<Value>>(forms: u8, column: Column, value: impl Fn(&R) -> V + 'a) -> Self {
        Self {
            forms,
            column,
            value: Box::new(move |row| value(row).into()),
        }
    }

    pub fn all<V: Into<Value>>(column: Column, value: impl Fn(&R) -> V + 'a) -> Self {
        Self::new(READ | CSV | JSON, column, value)
    }

    /// A field of the text table only.
    pub fn read<V: Into<Value>>(column: Column, value: impl Fn(&R) -> V + 'a) -> Self {
        Self::new(READ, column, value)
    }

    /// A field of the text table and of CSV.
    pub fn table<V: Into<Value>>(column: Column, value: impl Fn(&R) -> V + 'a) -> Self {
        Self::new(READ | CSV, column, value)
    }

    /// A field of CSV and JSON only.
    pub fn data<V: Into<Value>>(column: Column, value: impl Fn(&R) -> V + 'a) -> Self {
        Self::new(CSV | JSON, column, value)
    }

    pub fn json<V: Into<Value>>(column: Column, value: impl Fn(&R) -> V + 'a) -> Self {
        Self::new(JSON, column, value)
    }
}

pub struct View<'a, R> {
    fields: Vec<Field<'a, R>>,
}

impl<'a, R> View<'a, R> {
    /// A view of these fields; [`fields!`](crate::report::fields) lists them one a line.
    pub fn from_fields(fields: Vec<Field<'a, R>>) -> Self {
        Self { fields }
    }

    pub fn and(mut self, other: Self) -> Self {
        self.fields.extend(other.fields);
        self
    }

    pub fn without(mut self, column: Column) -> Self {
        self.fields.retain(|field| field.column.name != column.name);
        self
    }

    fn of_form(&self, form: u8) -> impl Iterator<Item = &Field<'a, R>> {
        let fields = self.fields.iter();
        fields.filter(move |field| field.forms & form != 0)
    }

    fn table(&self, form: u8, rows: &[R]) -> Table {
        let columns: Vec<Column> = self.of_form(form).map(|field| field.column).collect();
        let mut table = Table::new(&columns);
        for row in rows {
            table.push_row(self.of_form(form).map(|field| (field.value)(row)).collect());
        }
        table
    }

    /// The rows in every format; JSON is an array of objects.
    pub fn printout(&self, rows: &[R]) -> Printout {
        Printout {
            json: Some(self.objects(rows).into()),
            ..Printout::new(self.table(READ, rows)).csv_of(self.table_of(rows))
        }
    }

    pub fn table_of(&self, rows: &[R]) -> Table {
        self.table(CSV, rows)
    }

    pub fn object(&self, row: &R) -> Json {
        let fields = self.of_form(JSON);
        let pair = |field: &Field<R>| (field.column.name.into(), (field.value)(row).json());
        Json::Object(fields.map(pair).collect())
    }

    pub fn objects(&self, rows: &[R]) -> Vec<Json> {
        rows.iter().map(|row| self.object(row)).collect()
    }

    pub fn columns(&self) -> Vec<Column> {
        self.of_form(CSV).map(|field| field.column).collect()
    }

    /// Values of a row under these columns, for rows that are written one by one.
    pub fn row(&self, row: &R) -> Vec<Value> {
        self.of_form(CSV).map(|field| (field.value)(row)).collect()
    }
}

/// Defines a function that returns the [`View`] of a result. A line has the formats, the column by
/// its name in [`columns`](crate::report::columns), and the value of a row.
macro_rules! fields {
    ($(#[$doc:meta])* $vis:vis fn $name:ident($row:ident: $row_type:ty $(, $more:ident: $kind:ty)*) {
        $($form:ident $column:expr => $value:expr;)*
    }) => {
        $(#[$doc])*
        $vis fn $name<'a>($($more: &'a $kind),*) -> $crate::report::View<'a, $row_type> {
            use $crate::report::columns::*;
            $crate::report::View::from_fields(vec![
                $($crate::report::Field::$form($column, move |$row: &$row_type| $value)),*
            ])
        }
    };
}
pub(crate) use fields;
